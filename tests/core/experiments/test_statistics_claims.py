"""A claim is printed as holding only where its interval supports it."""

import numpy as np
import pytest

from sfid_core.experiments.claims import (
    Claim,
    Direction,
    differs,
    is_equivalent,
    is_extreme,
    reaches,
)
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import Interval, Resampling

RNG = np.random.default_rng(20)
BASE = RNG.normal(20, 3, size=100)
LESS = BASE - 2 + RNG.normal(0, 1, size=100)
SAME = BASE + np.tile([-1.0, 0.5, 1.5, -0.5, -0.5], 20)
MORE = BASE + 3 + RNG.normal(0, 1, size=100)
HOW = Resampling(seed=5)


def test_a_planted_difference_is_shown_in_its_direction_only() -> None:
    fewer = differs("a needs fewer steps", LESS, BASE, Direction.LESS, HOW)
    more = differs("a needs more steps", LESS, BASE, Direction.MORE, HOW)
    assert (fewer.holds, more.holds) == (True, False)
    assert fewer.ci == more.ci
    assert fewer.ci.lo < fewer.difference < fewer.ci.hi < 0
    assert fewer.difference == pytest.approx(-2, abs=0.3)


def test_no_difference_is_not_shown_in_either_direction() -> None:
    assert not differs("less", SAME, BASE, Direction.LESS, HOW).holds
    assert not differs("more", SAME, BASE, Direction.MORE, HOW).holds


def test_too_few_seeds_show_nothing_however_clear_they_are() -> None:
    few = slice(0, 9)
    assert not differs("less", LESS[few] - 10, BASE[few], Direction.LESS, HOW).holds
    assert not is_equivalent("equal", BASE[few], BASE[few]).holds
    assert not reaches("agrees", np.ones(9), 0.5, HOW).holds
    assert differs("less", LESS[:10] - 10, BASE[:10], Direction.LESS, HOW).holds


def test_equivalence_is_shown_for_equal_arms_and_not_for_a_planted_difference() -> None:
    equal = is_equivalent("a and b are equivalent", SAME, BASE)
    assert (equal.holds, equal.level) == (True, 0.9)
    assert equal.margin == pytest.approx(0.1 * BASE.mean())
    assert not is_equivalent("a and b are equivalent", MORE, BASE).holds
    assert not is_equivalent("a and b are equivalent", MORE, LESS).holds
    assert is_equivalent("returns below zero have a margin too", -SAME, -BASE).holds


def test_the_margin_of_equivalence_is_a_share_of_the_second_arm_s_mean() -> None:
    assert is_equivalent("", MORE, LESS, 0.2).margin == pytest.approx(0.2 * LESS.mean())
    assert is_equivalent("", LESS, MORE, 0.2).margin == pytest.approx(0.2 * MORE.mean())


def test_an_extreme_has_to_beat_every_rival_and_names_the_nearest() -> None:
    worst = is_extreme("c is worst", MORE, {"a": LESS, "b": SAME}, Direction.MORE, HOW)
    assert (worst.holds, worst.claim) == (True, "c is worst (nearest: b)")
    assert worst.difference == pytest.approx(float(np.mean(MORE - SAME)))
    best = is_extreme("a is best", LESS, {"b": SAME, "c": MORE}, Direction.LESS, HOW)
    assert (best.holds, best.claim) == (True, "a is best (nearest: b)")
    tied = is_extreme("b is worst", SAME, {"a": LESS, "d": BASE}, Direction.MORE, HOW)
    assert (tied.holds, tied.claim) == (False, "b is worst (nearest: d)")
    with pytest.raises(ExperimentError, match="has nobody to be compared with"):
        is_extreme("alone", LESS, {}, Direction.LESS, HOW)


def test_a_threshold_is_reached_only_where_the_whole_interval_is_above_it() -> None:
    agreement = np.clip(RNG.normal(0.95, 0.02, size=50), 0, 1)
    shown = reaches("the agent acts as the teacher prefers", agreement, 0.9, HOW)
    assert (shown.holds, shown.n_seeds) == (True, 50)
    assert shown.difference == pytest.approx(agreement.mean() - 0.9)
    assert not reaches("the agent acts as the teacher prefers", agreement, agreement.mean(), HOW).holds


def test_an_unsupported_claim_says_not_shown_and_a_supported_one_tells_its_numbers() -> None:
    shown = Claim(
        "sfid needs fewer steps",
        holds=True,
        difference=-2.5,
        ci=Interval(-3.1, -1.94),
        level=0.95,
        n_seeds=1000,
    )
    assert shown.line() == ("holds: sfid needs fewer steps: -2.5 [-3.1, -1.94] (1000 seeds, 95% interval)")
    open_ = Claim(
        "they are equivalent",
        holds=False,
        difference=0.2,
        ci=Interval(-0.5, 0.9),
        level=0.9,
        n_seeds=20,
        margin=0.61,
    )
    assert open_.line() == (
        "not shown: they are equivalent: +0.2 [-0.5, +0.9], margin 0.61 (20 seeds, 90% interval)"
    )


def test_the_document_of_a_claim_has_what_the_experiment_prints() -> None:
    claim = differs("less", [1.0] * 10 + [2.0] * 10, [4.0] * 20, Direction.LESS, HOW)
    document = claim.document()
    assert document == {
        "claim": "less",
        "holds": True,
        "difference": -2.5,
        "ci": [claim.ci.lo, claim.ci.hi],
        "level": 0.95,
        "seeds": 20,
        "cohen_dz": claim.cohen_dz,
        "superiority": 0.0,
    }


def test_a_claim_tells_the_unit_of_its_numbers() -> None:
    found = differs("less", [1.0] * 10 + [2.0] * 10, [4.0] * 20, Direction.LESS, HOW).measured_in("steps")
    lo, hi = (f"{edge:+.3g}" for edge in found.ci)
    assert found.line() == f"holds: less: -2.5 [{lo}, {hi}] steps (20 seeds, 95% interval)"
    assert found.document()["unit"] == "steps"


def test_chance_alone_is_claimed_as_rarely_as_the_level_says() -> None:
    """Both arms draw from one distribution; a claim in one direction is then wrong 2.5 % of the time."""
    rng = np.random.default_rng(21)
    how = Resampling(resamples=400)
    wrong = 0
    for _ in range(1000):
        a, b = rng.gamma(2, size=(2, 20))
        wrong += differs("less", a, b, Direction.LESS, how).holds
    assert 0.01 <= wrong / 1000 <= 0.045
