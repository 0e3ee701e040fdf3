"""Differences, effect sizes and equivalence against cases computed by hand."""

import math

import numpy as np
import pytest

from sfid_core.experiments.comparison import cohen_dz, compare, equivalence, superiority
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import Interval, Resampling

A = [5.0, 7.0, 6.0, 9.0, 8.0]
B = [4.0, 7.0, 3.0, 7.0, 4.0]
"""Differences 1, 0, 3, 2, 4: mean 2, sd sqrt(2.5)."""


def test_effect_sizes_are_those_computed_by_hand() -> None:
    assert cohen_dz(A, B) == pytest.approx(2 / math.sqrt(2.5))
    assert cohen_dz(B, A) == pytest.approx(-2 / math.sqrt(2.5))
    assert (superiority(A, B), superiority(B, A), superiority(A, A)) == (0.9, 0.1, 0.5)


def test_effect_sizes_of_constant_differences_do_not_divide_by_zero() -> None:
    assert cohen_dz(A, A) == 0.0
    assert cohen_dz([2, 3, 4], [1, 2, 3]) is None


def test_a_comparison_tells_means_difference_and_intervals() -> None:
    found = compare(A, B, Resampling(seed=1))
    assert (found.n_seeds, found.mean_a, found.mean_b, found.difference) == (5, 7.0, 5.0, 2.0)
    assert found.cohen_dz == pytest.approx(2 / math.sqrt(2.5))
    assert found.superiority == 0.9
    assert 0 <= found.ci.lo < 2 < found.ci.hi <= 4
    assert found.superiority_ci.lo < 0.9 < found.superiority_ci.hi <= 1


def test_pairing_finds_a_difference_that_is_small_beside_the_spread_of_seeds() -> None:
    rng = np.random.default_rng(1)
    luck = rng.normal(20, 10, size=200)
    a, b = luck + rng.normal(0.5, 1, size=200), luck + rng.normal(0, 1, size=200)
    paired = compare(a, b, Resampling()).ci
    unpaired = compare(a, rng.permutation(b), Resampling()).ci
    assert paired.above(0)
    assert not unpaired.above(0)


@pytest.mark.parametrize("planted", [-0.3, 0.0, 0.3])
def test_intervals_of_differences_cover_a_planted_effect(planted: float) -> None:
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(400):
        luck = rng.gamma(2, size=30)
        a, b = luck + planted + rng.normal(0, 0.5, size=30), luck + rng.normal(0, 0.5, size=30)
        ci = compare(a, b, Resampling(resamples=400)).ci
        held += ci.lo <= planted <= ci.hi
    assert 0.91 <= held / 400 <= 0.98


def test_equivalence_is_the_one_computed_by_hand() -> None:
    """Mean 2, standard error sqrt(0.5), df 4, margin 4: t = 2.828427, upper tail 0.0237103."""
    found = equivalence(A, B, margin=4.0)
    half = 2.131847 * math.sqrt(0.5)
    assert (found.n_seeds, found.difference, found.margin, found.holds) == (5, 2.0, 4.0, True)
    assert found.ci == pytest.approx((2 - half, 2 + half), abs=1e-6)
    assert found.p == pytest.approx(0.0237103, abs=1e-7)


def test_two_one_sided_tests_reject_exactly_where_their_interval_lies_within_the_margins() -> None:
    rng = np.random.default_rng(3)
    verdicts = set()
    for shift in np.linspace(-2, 2, 81):
        b = rng.normal(10, 1, size=12)
        found = equivalence(b + shift + rng.normal(0, 0.8, size=12), b, margin=1.0)
        assert found.holds == (found.ci.lo > -1.0 and found.ci.hi < 1.0)
        verdicts.add((found.holds, found.difference > 0))
    assert verdicts == {(True, True), (True, False), (False, True), (False, False)}


@pytest.mark.parametrize("side", [-1, 1])
def test_a_difference_at_the_margin_is_called_equivalent_at_most_as_often_as_alpha_says(side: int) -> None:
    rng = np.random.default_rng(4)
    wrong = sum(equivalence(rng.normal(side, 1, 25), np.zeros(25), margin=1.0).holds for _ in range(2000))
    assert 0.03 <= wrong / 2000 <= 0.065


def test_noise_alone_is_no_equivalence() -> None:
    """That no difference was found does not show that there is none."""
    rng = np.random.default_rng(5)
    a, b = rng.normal(10, 20, size=(2, 10))
    assert not equivalence(a, b, margin=1.0).holds


def test_learners_that_did_the_same_are_equivalent_and_a_constant_gap_is_not() -> None:
    same = equivalence(A, A, margin=0.1)
    assert (same.difference, same.ci, same.p, same.holds) == (0.0, Interval(0.0, 0.0), 0.0, True)
    gap = equivalence([3, 4, 5], [2, 3, 4], margin=1.0)
    assert (gap.ci, gap.p, gap.holds) == (Interval(1.0, 1.0), 1.0, False)
    assert not equivalence([0, 0], [0, 0], margin=0.0).holds


def test_arms_that_are_no_pairs_are_refused_in_one_line() -> None:
    with pytest.raises(ExperimentError, match="are no pairs: run both with the same seeds"):
        compare([1, 2, 3], [1, 2], Resampling())
    with pytest.raises(ExperimentError, match="needs at least 2"):
        equivalence([1], [2], margin=1)
    for margin in (-1.0, math.nan, math.inf):
        with pytest.raises(ExperimentError, match="is no finite number of 0 or more"):
            equivalence(A, B, margin)
    with pytest.raises(ExperimentError, match=r"outside \(0, 0\.5\)"):
        equivalence(A, B, 1.0, alpha=0.5)
