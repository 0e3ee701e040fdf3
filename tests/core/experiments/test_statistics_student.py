"""Student's t against printed tables and closed forms."""

import math

import pytest

from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.student import normal_cdf, normal_quantile, t_quantile, t_upper_tail


@pytest.mark.parametrize(
    "df, at_90, at_95, at_975, at_995",
    [
        (1, 3.078, 6.314, 12.706, 63.657),
        (2, 1.886, 2.920, 4.303, 9.925),
        (5, 1.476, 2.015, 2.571, 4.032),
        (10, 1.372, 1.812, 2.228, 3.169),
        (29, 1.311, 1.699, 2.045, 2.756),
        (120, 1.289, 1.658, 1.980, 2.617),
    ],
)
def test_t_quantiles_are_those_of_the_printed_table(
    df: int, at_90: float, at_95: float, at_975: float, at_995: float
) -> None:
    found = [round(t_quantile(p, df), 3) for p in (0.9, 0.95, 0.975, 0.995)]
    assert found == [at_90, at_95, at_975, at_995]
    assert [round(t_quantile(1 - p, df), 3) for p in (0.9, 0.95)] == [-at_90, -at_95]


@pytest.mark.parametrize("t", [-30.0, -1.5, 0.0, 0.3, 1.0, 2.5, 40.0, 1e4, 1e8])
def test_tails_of_one_and_two_degrees_of_freedom_are_the_closed_forms(t: float) -> None:
    """One: the Cauchy distribution. Two: 1/2 - t / (2 sqrt(2 + t^2)), written without cancellation."""
    root = math.sqrt(2 + t * t)
    two = 1 / (root * (root + t)) if t > 0 else 0.5 - t / (2 * root)
    one = math.atan(1 / t) / math.pi if t > 0 else 0.5 - math.atan(t) / math.pi
    assert t_upper_tail(t, 1) == pytest.approx(one, rel=1e-12)
    assert t_upper_tail(t, 2) == pytest.approx(two, rel=1e-12)


@pytest.mark.parametrize("df", [1, 3, 8, 30, 999])
def test_quantiles_and_tails_undo_each_other(df: int) -> None:
    for p in (1e-12, 1e-4, 0.2, 0.5, 0.7, 0.999):
        assert 1 - t_upper_tail(t_quantile(1 - p, df), df) == pytest.approx(1 - p, rel=1e-9)
        assert t_upper_tail(-t_quantile(p, df), df) == pytest.approx(p, rel=1e-9)


def test_many_degrees_of_freedom_come_to_the_normal_distribution() -> None:
    for z in (-2.0, 0.5, 1.96, 3.0):
        assert t_upper_tail(z, 10_000_000) == pytest.approx(1 - normal_cdf(z), rel=1e-5)
    assert normal_quantile(0.975) == pytest.approx(1.959964, abs=1e-6)


def test_infinite_t_has_no_tail() -> None:
    assert (t_upper_tail(math.inf, 5), t_upper_tail(-math.inf, 5)) == (0.0, 1.0)


def test_one_seed_and_impossible_probabilities_are_refused_in_one_line() -> None:
    with pytest.raises(ExperimentError, match="a t test needs at least 2 seeds"):
        t_upper_tail(1, 0)
    for p in (0.0, 1.0, -0.1):
        with pytest.raises(ExperimentError, match=r"outside \(0, 1\)"):
            t_quantile(p, 5)
