"""exp and log of the kernels against those of the C library, and compiled against not."""

import math
from random import Random

import pytest

from sfid_core.compiled import compiled, compiler_available
from sfid_core.learning.elementary import exp, log

NUMBERS = [Random(1).uniform(-700, 700) for _ in range(500)] + [n / 64 for n in range(-640, 641)]


def test_exp_is_within_a_few_units_in_the_last_place() -> None:
    assert all(abs(exp(x) / math.exp(x) - 1) < 1e-15 for x in NUMBERS)
    assert [exp(0.0), exp(-1000.0), exp(800.0)] == [1.0, 0.0, exp(709.0)]


def test_log_is_within_a_few_units_in_the_last_place() -> None:
    for x in NUMBERS:
        y = math.exp(x)
        assert log(y) == pytest.approx(math.log(y), rel=1e-15, abs=1e-15)
    assert log(1.0) == 0.0


@pytest.mark.skipif(not compiler_available(), reason="numba is not installed")
def test_compiled_they_have_the_same_bits() -> None:
    fast_exp, fast_log = compiled(exp, {}, ""), compiled(log, {}, "")
    assert [fast_exp(x) for x in NUMBERS] == [exp(x) for x in NUMBERS]
    assert [fast_log(math.exp(x)) for x in NUMBERS] == [log(math.exp(x)) for x in NUMBERS]
