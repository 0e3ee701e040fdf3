"""Intervals of means: by hand, by counting, and by how often they hold what is true."""

import math
import time
from fractions import Fraction
from statistics import NormalDist

import numpy as np
import pytest

from sfid_core.chance import below, stream
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import (
    BLOCK_DRAWS,
    Interval,
    IntervalKind,
    Resampling,
    bootstrap_means,
    exact_means,
    mean_interval,
    mean_intervals,
    student_interval,
    wilson_intervals,
)
from sfid_core.experiments.student import t_quantile

KINDS = list(IntervalKind)


def test_resampled_means_are_the_means_of_the_drawn_seeds() -> None:
    values = np.array([1.0, 2.0, 4.0, 8.0, 16.0])
    resampling = Resampling(seed=3, resamples=100)
    key = stream(3, "bootstrap", 5)
    by_hand = [float(np.mean([values[below(key, 5 * row + k, 5)] for k in range(5)])) for row in range(100)]
    assert bootstrap_means(values, resampling).tolist() == pytest.approx(by_hand, abs=1e-12)


def test_resamples_of_later_blocks_go_on_where_the_first_block_ended() -> None:
    values = np.random.default_rng(1).normal(size=40)
    resamples = 110_000
    assert resamples * 40 > BLOCK_DRAWS
    many = bootstrap_means(values, Resampling(resamples=resamples))
    assert many[:500].tobytes() == bootstrap_means(values, Resampling(resamples=500)).tobytes()
    key, last = stream(0, "bootstrap", 40), resamples - 1
    by_hand = np.mean([values[below(key, 40 * last + k, 40)] for k in range(40)])
    assert many[last] == pytest.approx(by_hand, abs=1e-12)


def test_columns_and_calls_share_the_drawn_seeds_so_that_differences_are_paired() -> None:
    a, b = np.random.default_rng(2).normal(size=(2, 50))
    paired = bootstrap_means(a, Resampling()) - bootstrap_means(b, Resampling())
    assert paired == pytest.approx(bootstrap_means(a - b, Resampling()), abs=1e-12)
    together = bootstrap_means(np.stack([a, b], axis=1), Resampling())
    assert together[:, 0].tobytes() == bootstrap_means(a, Resampling()).tobytes()


@pytest.mark.parametrize("scale", [1e-280, 1e-9, 1.0, 1e12])
def test_sums_are_exact_so_that_the_order_of_seeds_does_not_matter(scale: float) -> None:
    values = np.random.default_rng(4).normal(size=1000) * scale
    shuffled = np.random.default_rng(5).permutation(values)
    assert float(exact_means(values)) == float(exact_means(shuffled))
    truth = sum(map(Fraction, values.tolist()), Fraction(0)) / 1000
    assert float(exact_means(values)) == pytest.approx(float(truth), abs=scale * 1e-11)


def test_whole_numbers_have_their_exact_mean() -> None:
    assert exact_means([[1, 200], [2, 11], [6, 11]]).tolist() == [3.0, 74.0]


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_bits_and_another_seed_others(kind: IntervalKind) -> None:
    values = np.random.default_rng(6).gamma(2, size=(100, 4))
    first = mean_intervals(values, Resampling(seed=1, kind=kind))
    assert mean_intervals(values, Resampling(seed=1, kind=kind)).tobytes() == first.tobytes()
    assert (mean_intervals(values, Resampling(seed=2, kind=kind)) != first).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n_seeds, low, high", [(10, 0.92, 0.975), (100, 0.935, 0.965)])
def test_intervals_of_normal_values_cover_the_mean_as_often_as_they_say(
    kind: IntervalKind, n_seeds: int, low: float, high: float
) -> None:
    values = np.random.default_rng(7).normal(5.0, 2.0, size=(n_seeds, 4000))
    found = mean_intervals(values, Resampling(resamples=1000, kind=kind))
    assert low <= ((found[:, 0] <= 5.0) & (found[:, 1] >= 5.0)).mean() <= high


@pytest.mark.parametrize("kind", KINDS)
def test_intervals_of_skewed_counts_cover_the_mean_nearly_as_often_as_they_say(kind: IntervalKind) -> None:
    """Steps of an episode look like this: many short, few at the cap."""
    values = np.random.default_rng(8).geometric(0.05, size=(200, 3000)).astype(np.float64)
    found = mean_intervals(values, Resampling(resamples=1000, kind=kind))
    assert 0.925 <= ((found[:, 0] <= 20.0) & (found[:, 1] >= 20.0)).mean() <= 0.965


@pytest.mark.parametrize("kind", KINDS)
def test_few_seeds_of_normal_values_get_the_width_of_students_interval(kind: IntervalKind) -> None:
    values = np.random.default_rng(13).normal(size=(10, 400))
    found = mean_intervals(values, Resampling(resamples=4000, kind=kind))
    students = [np.subtract(*student_interval(column)[::-1]) for column in values.T]
    assert float(np.mean(found[:, 1] - found[:, 0]) / np.mean(students)) == pytest.approx(1, abs=0.02)


def test_bca_takes_the_quantiles_of_its_definition() -> None:
    """Efron's formulas written out: the bias by counting, the acceleration by leaving one out."""
    values = np.random.default_rng(14).gamma(0.7, size=12)
    resampling = Resampling(seed=8, resamples=3000, kind=IntervalKind.BCA)
    means = bootstrap_means(values, resampling)
    normal = NormalDist()
    bias = normal.inv_cdf(float(np.mean(means < values.mean())))
    left_out = np.array([np.delete(values, seed).mean() for seed in range(12)])
    gaps = left_out.mean() - left_out
    acceleration = float((gaps**3).sum() / (6 * (gaps**2).sum() ** 1.5))
    z = math.sqrt(12 / 11) * t_quantile(0.975, 11)
    ranks = [normal.cdf(bias + (bias + w) / (1 - acceleration * (bias + w))) for w in (-z, z)]
    assert mean_interval(values, resampling) == pytest.approx(np.quantile(means, ranks).tolist(), abs=1e-9)
    assert abs(bias) > 0.01


def test_bca_is_shifted_towards_the_long_tail() -> None:
    values = np.random.default_rng(9).gamma(0.5, size=(30, 300))
    percentile = mean_intervals(values, Resampling())
    bca = mean_intervals(values, Resampling(kind=IntervalKind.BCA))
    assert (bca.mean(axis=0) > percentile.mean(axis=0)).all()


@pytest.mark.parametrize("kind", KINDS)
def test_many_seeds_give_the_interval_of_the_normal_approximation(kind: IntervalKind) -> None:
    values = np.random.default_rng(10).normal(size=2000)
    lo, hi = mean_interval(values, Resampling(resamples=10_000, kind=kind))
    expected = student_interval(values)
    assert (lo, hi) == pytest.approx(expected, abs=0.004)


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_column_has_an_interval_of_no_width(kind: IntervalKind) -> None:
    assert mean_interval([11.0] * 20, Resampling(kind=kind)) == Interval(11.0, 11.0)


def test_students_interval_is_the_one_computed_by_hand() -> None:
    """Mean 3, sd sqrt(2.5), n 5, t(0.975, 4) 2.776445: half width 1.963243."""
    assert student_interval([1, 2, 3, 4, 5]) == pytest.approx((1.036757, 4.963243), abs=1e-6)


def test_wilsons_interval_is_the_one_computed_by_hand() -> None:
    """For p = 1 it is [n / (n + z^2), 1], and its mirror for p = 0; 8 of 10 is a textbook case."""
    found = wilson_intervals([1.0, 0.0, 0.8], 10)
    assert found[0].tolist() == pytest.approx([10 / (10 + 1.959964**2), 1.0], abs=1e-7)
    assert found[1].tolist() == pytest.approx([0.0, 1 - 10 / (10 + 1.959964**2)], abs=1e-7)
    assert found[2].tolist() == pytest.approx([0.4902, 0.9433], abs=1e-4)
    assert (found[0, 1], found[1, 0]) == (1.0, 0.0)


def test_intervals_keep_the_shape_of_their_columns() -> None:
    values = np.random.default_rng(11).normal(size=(12, 3, 5))
    found = mean_intervals(values, Resampling())
    assert found.shape == (3, 5, 2)
    assert found[1, 4].tolist() == mean_intervals(values[:, 1, 4], Resampling()).tolist()


def test_simultaneous_intervals_are_wider() -> None:
    assert Resampling().simultaneous(5).level == pytest.approx(0.99)
    assert Resampling(level=0.9, seed=4).simultaneous(0) == Resampling(level=0.9, seed=4)


def test_an_interval_knows_its_side() -> None:
    assert (Interval(0.1, 2).above(0), Interval(0, 2).above(0)) == (True, False)
    assert (Interval(-2, -0.1).below(0), Interval(-2, 0).below(0)) == (True, False)


def test_what_has_no_interval_is_refused_in_one_line() -> None:
    with pytest.raises(ExperimentError, match="1 seeds: this needs at least 2; run more seeds"):
        mean_interval([1.0], Resampling())
    with pytest.raises(ExperimentError, match="seed number 2 has a value that is not a finite number"):
        mean_intervals([[1.0, 2.0], [3.0, 4.0], [math.nan, 5.0]], Resampling())
    with pytest.raises(ExperimentError, match="resamples 99 is outside"):
        Resampling(resamples=99)
    with pytest.raises(ExperimentError, match=r"level 1\.0 is outside"):
        Resampling(level=1.0)
    with pytest.raises(ExperimentError, match="have no Wilson interval"):
        wilson_intervals([1.1], 10)


def test_the_founding_experiment_is_summarised_within_seconds() -> None:
    """4 conditions x 30 episodes x 6 measures x 1,000 seeds x 2,000 resamples; a loop would take minutes."""
    values = np.random.default_rng(12).gamma(2, size=(1000, 4, 6, 30))
    begin = time.perf_counter()
    found = mean_intervals(values, Resampling())
    assert time.perf_counter() - begin < 5
    assert found.shape == (4, 6, 30, 2)
