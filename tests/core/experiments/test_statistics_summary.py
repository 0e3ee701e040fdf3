"""Arms and what they come to, and the founding paper's claims on planted results."""

import json
from collections.abc import Mapping

import numpy as np
import pytest

from sfid_core.experiments.claims import Claim
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.founding_claims import founding_claims
from sfid_core.experiments.intervals import Floats, Resampling, mean_intervals
from sfid_core.experiments.summary import FOUNDING_MEASURES, Arm, Measure, summarise

N_SEEDS, N_EPISODES = 60, 8


def tables(seed: int, shift: float = 0.0) -> dict[Measure, Floats]:
    """Results whose seeds share their luck between arms; `shift` makes every measure worse."""
    luck = np.random.default_rng(0).gamma(20, size=(N_SEEDS, N_EPISODES))
    own = np.random.default_rng(seed).normal(0, 0.5, size=(4, N_SEEDS, N_EPISODES))
    worse = {measure: luck + own[place] + shift for place, measure in enumerate(FOUNDING_MEASURES)}
    return worse | {Measure.DISCOUNTED_RETURN: 30 - luck + own[2] - shift}


def four_arms(shifts: Mapping[tuple[str, str], float]) -> list[Arm]:
    names = [("sfid", "expert"), ("reward", "expert"), ("sfid", "naive"), ("reward", "naive")]
    return [Arm(*name, tables(number, shifts.get(name, 0.0))) for number, name in enumerate(names, start=1)]


def verdicts(claims: tuple[Claim, ...]) -> list[bool]:
    return [claim.holds for claim in claims]


def test_a_summary_has_the_means_and_intervals_of_every_measure() -> None:
    steps = np.arange(24, dtype=np.float64).reshape(6, 4)
    solved = np.array([[0.0, 1, 1, 1]] * 3 + [[0.0, 0, 1, 1]] * 3)
    arm = Arm("sfid", "expert", {Measure.STEPS: steps, Measure.SOLVED: solved}, {"effort": steps[:, 0]})
    (found,) = summarise([arm], Resampling(seed=9))
    intervals = mean_intervals(steps, Resampling(seed=9))
    effort = mean_intervals(steps[:, 0], Resampling(seed=9))
    document = found.document()
    assert json.loads(json.dumps(document)) == document
    assert list(document) == [
        *("method", "teacher", "seeds", "steps", "steps_ci", "solved", "solved_ci", "effort", "effort_ci")
    ]
    assert (document["method"], document["teacher"], document["seeds"]) == ("sfid", "expert", 6)
    assert document["steps"] == [10.0, 11.0, 12.0, 13.0]
    assert document["steps_ci"] == intervals.tolist()
    assert document["solved"] == [0.0, 0.5, 1.0, 1.0]
    assert [document["effort"], document["effort_ci"]] == [10.0, effort.tolist()]


def test_a_measure_on_which_all_seeds_agree_keeps_an_interval_where_it_is_a_share() -> None:
    arm = Arm("sfid", "expert", {Measure.SOLVED: np.ones((10, 2))})
    (found,) = summarise([arm], Resampling())
    assert found.intervals[Measure.SOLVED].tolist() == [[pytest.approx(0.7225, abs=1e-4), 1.0]] * 2


def test_an_arm_may_have_numbers_a_seed_alone() -> None:
    (found,) = summarise([Arm("dagger", "noisy", {}, {"success": np.ones(5)})], Resampling())
    assert found.document() == {
        "method": "dagger",
        "teacher": "noisy",
        "seeds": 5,
        "success": 1.0,
        "success_ci": [1.0, 1.0],
    }


def test_tables_of_different_seeds_are_refused_in_one_line() -> None:
    with pytest.raises(ExperimentError, match="tables of arm sfid, expert disagree"):
        Arm("sfid", "expert", {Measure.STEPS: np.ones((3, 2)), Measure.INPUTS: np.ones((4, 2))})
    with pytest.raises(ExperimentError, match="give \\[n_seeds, n_episodes\\] and \\[n_seeds\\]"):
        Arm("sfid", "expert", {Measure.STEPS: np.ones((3, 2))}, {"effort": np.ones(2)})
    with pytest.raises(ExperimentError, match="disagree"):
        Arm("sfid", "expert", {Measure.STEPS: np.ones(3)})


def test_the_papers_pattern_holds_on_results_that_have_it() -> None:
    claims = founding_claims(four_arms({("sfid", "naive"): 1.0, ("reward", "naive"): 4.0}), Resampling())
    assert verdicts(claims) == [True] * 10
    assert [claim.claim for claim in claims] == [
        "with the expert, sfid and reward are equivalent in |TD error|",
        "with the expert, sfid and reward are equivalent in steps",
        "with the expert, sfid and reward are equivalent in discounted return",
        "with the expert, sfid and reward are equivalent in inputs",
        "with the naive teacher, sfid needs fewer steps than reward",
        "with the naive teacher, sfid needs fewer inputs than reward",
        "reward with the naive teacher is the worst of the four in |TD error| (nearest: sfid, naive)",
        "reward with the naive teacher is the worst of the four in steps (nearest: sfid, naive)",
        "reward with the naive teacher is the worst of the four in discounted return (nearest: sfid, naive)",
        "reward with the naive teacher is the worst of the four in inputs (nearest: sfid, naive)",
    ]


def test_the_papers_pattern_is_not_shown_on_results_without_it() -> None:
    no_gap = founding_claims(four_arms({}), Resampling())
    assert verdicts(no_gap) == [True] * 4 + [False] * 6
    unequal = founding_claims(four_arms({("reward", "expert"): 5.0, ("reward", "naive"): 5.0}), Resampling())
    assert verdicts(unequal) == [False] * 4 + [True] * 2 + [False] * 4


def test_teaching_time_is_claimed_where_it_was_measured() -> None:
    arms = four_arms({})
    seconds = np.random.default_rng(9).gamma(20, size=N_SEEDS)
    factors = (1.0, 1.01, 1.2, 1.5)
    timed = [
        Arm(arm.method, arm.teacher, arm.measures, {"teaching_time_s": seconds * factor})
        for arm, factor in zip(arms, factors, strict=True)
    ]
    claims = founding_claims(timed, Resampling())
    assert claims[:10] == founding_claims(arms, Resampling())
    assert [(claim.claim, claim.holds) for claim in claims[10:]] == [
        ("with the expert, sfid and reward are equivalent in teaching time", True),
        ("with the naive teacher, sfid needs less teaching time than reward", True),
    ]


def test_a_missing_arm_is_named() -> None:
    with pytest.raises(ExperimentError, match="the paper's claims need the arm reward, naive"):
        founding_claims(four_arms({})[:3], Resampling())
