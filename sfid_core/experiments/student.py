"""Student's t distribution and the normal one, as far as paired tests need them."""

import math
from statistics import NormalDist

from sfid_core.experiments.errors import ExperimentError

_NORMAL = NormalDist()
_TERMS_MAX = 10_000
_TINY = 1e-300
"""Stands for a zero denominator in Lentz's method; far below every term, far above the smallest float."""


def normal_cdf(z: float) -> float:
    """Return P(Z <= z) of the standard normal."""
    return _NORMAL.cdf(z)


def normal_quantile(p: float) -> float:
    """Return z with P(Z <= z) = p, for p in (0, 1)."""
    return _NORMAL.inv_cdf(p)


def t_upper_tail(t: float, df: int) -> float:
    """Return P(T > t) for `df` degrees of freedom, 1 or more; small tails keep their relative precision.

    P(T > t) = I_x(df / 2, 1 / 2) / 2 with x = df / (df + t^2) for t >= 0 (Abramowitz & Stegun 26.7.1).
    """
    if df < 1:
        raise ExperimentError(f"{df} degrees of freedom: a t test needs at least 2 seeds")
    if math.isinf(t):
        return 0.0 if t > 0 else 1.0
    x = df / (df + t * t)
    tail = 0.5 * _regularised_beta(x, t * t / (df + t * t), df / 2, 0.5)
    return tail if t >= 0 else 1 - tail


def t_quantile(p: float, df: int) -> float:
    """Return t with P(T <= t) = p for `df` degrees of freedom, p in (0, 1), by bisection of the tail."""
    if not 0 < p < 1:
        raise ExperimentError(f"probability {p} of a quantile is outside (0, 1)")
    tail = min(p, 1 - p)
    lo, hi = 0.0, 1.0
    while t_upper_tail(hi, df) > tail:
        lo, hi = hi, hi * 2
    while True:
        mid = (lo + hi) / 2
        if mid in (lo, hi):
            return mid if p > 0.5 else -mid
        if t_upper_tail(mid, df) > tail:
            lo = mid
        else:
            hi = mid


def _regularised_beta(x: float, rest: float, a: float, b: float) -> float:
    """Return I_x(a, b), where rest = 1 - x is given apart because it may be too small to subtract."""
    if x <= 0:
        return 0.0
    if rest <= 0:
        return 1.0
    log_front = math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log(rest)
    front = math.exp(log_front)
    # The fraction converges fast left of the mean of the beta distribution; right of it, use the mirror.
    if x < (a + 1) / (a + b + 2):
        return front * _beta_fraction(x, a, b) / a
    return 1 - front * _beta_fraction(rest, b, a) / b


def _beta_fraction(x: float, a: float, b: float) -> float:
    """Return the continued fraction of I_x(a, b) (Abramowitz & Stegun 26.5.8) by Lentz's method."""
    c, d = 1.0, 1 - (a + b) * x / (a + 1)
    d = 1 / (d or _TINY)
    value = d
    for m in range(1, _TERMS_MAX):
        even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        for term in (even, odd):
            d = 1 / ((1 + term * d) or _TINY)
            c = (1 + term / c) or _TINY
            value *= c * d
        if abs(c * d - 1) < 1e-15:
            break
    return value
