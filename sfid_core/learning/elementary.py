"""exp and log as kernels: float64 arithmetic in a stated order, the same bits on any machine.

The C library's differ in the last bit from one to the next, and a learner that draws from a softmax would
then learn something else elsewhere. Both are within a few units in the last place.
"""

from math import frexp, ldexp

from sfid_core.compiled import kernel

_LN2_HIGH = 6.93147180369123816490e-01
"""The first 32 bits of ln 2: times a whole number below 2**20 it is exact."""
_LN2_LOW = 1.90821492927058770002e-10
_EXP_MAX = 709.0
_EXP_MIN = -708.0
_ROOT_HALF = 0.7071067811865476


@kernel
def exp(x: float) -> float:
    """Return e**x; 0 below -708 and e**709 above 709, the largest that float64 holds.

    x = k ln 2 + r with |r| <= ln 2 / 2; e**r by thirteen terms of its series.
    """
    if x < _EXP_MIN:
        return 0.0
    x = min(x, _EXP_MAX)
    halves = x / _LN2_HIGH
    k = int(halves + 0.5) if halves >= 0.0 else -int(0.5 - halves)
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    total = 1.0
    for n in range(13, 0, -1):
        total = 1.0 + total * r / n
    return ldexp(total, k)


@kernel
def log(x: float) -> float:
    """Return the natural logarithm of x > 0.

    x = m 2**k with m in [sqrt 1/2, sqrt 2); ln m = 2 atanh((m - 1) / (m + 1)) by eleven terms of its series.
    """
    m, k = frexp(x)
    if m < _ROOT_HALF:
        m *= 2.0
        k -= 1
    s = (m - 1.0) / (m + 1.0)
    square = s * s
    total = 0.0
    for n in range(21, 0, -2):
        total = total * square + 1.0 / n
    return k * _LN2_HIGH + (2.0 * s * total + k * _LN2_LOW)
