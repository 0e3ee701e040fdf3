"""The benefit of guidance: when a seed has converged, how the benefit is told, and what trend it shows."""

import numpy as np
import pytest

from sfid_core.experiments.condition import Results
from sfid_core.experiments.guidance import (
    ARMS,
    CONVERGED,
    EPISODES,
    GUIDED,
    INPUTS,
    REWARD,
    SIZES,
    STEPS,
    UNDOING,
    arm,
    benefits,
    claims,
    conditions,
    room,
    room_name,
)
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.lane_world import COLUMNS
from sfid_core.experiments.summary import Arm
from sfid_core.sokoban.levels import parse_levels


def test_a_room_has_one_box_and_its_goal_in_the_middle() -> None:
    assert room(4) == "######\n#    #\n# $  #\n#  . #\n#   @#\n######"
    assert [parse_levels(room(size))[0].width - 2 for size in SIZES] == list(SIZES)


def told(steps: list[int], optimal: int = 10) -> Results:
    results = np.zeros((2, EPISODES, COLUMNS))
    results[:, :, 0] = steps + [10] * (EPISODES - len(steps))
    results[:, :, 5] = 2
    results[:, :, 7] = 1
    results[:, :, 8] = optimal
    return results


@pytest.mark.parametrize(
    "steps,expected,inputs",
    [([50, 30], 90, 6), ([50, 12, 13], 85, 8), ([], 10, 2), ([13] * EPISODES, 13 * EPISODES, 2 * EPISODES)],
    ids=["after two", "a lucky one does not count", "at once", "never: the whole run"],
)
def test_a_seed_has_converged_when_five_episodes_in_a_row_are_near_the_fewest_steps(
    steps: list[int], expected: int, inputs: int
) -> None:
    found = arm(conditions("4")[0], told(steps)).totals
    converged = len(steps) < EPISODES
    told_of = [found[name].tolist() for name in (STEPS, INPUTS, CONVERGED)]
    assert told_of == [[number] * 2 for number in (expected, inputs, converged)]


def arms(powers: dict[str, float]) -> list[Arm]:
    rng = np.random.default_rng(3)
    return [
        Arm(method, room_name(size), {}, {STEPS: size ** powers[method] * np.exp(rng.normal(0, 0.1, 40))})
        for size in SIZES
        for method in ARMS
    ]


def test_a_benefit_that_grows_is_shown_and_one_that_does_not_is_not() -> None:
    found = claims(arms({REWARD: 4.0, GUIDED: 2.0, UNDOING: 4.0}), Resampling())
    assert [one.holds for one in found] == [True] * len(SIZES) + [True, False]
    assert found[-2].difference == pytest.approx(1.0, abs=0.15)


def test_the_benefit_is_how_many_times_fewer_steps() -> None:
    found = benefits(arms({REWARD: 4.0, GUIDED: 2.0, UNDOING: 4.0}), Resampling())
    ratios = {(one.room, one.method): one.ratio for one in found}
    assert ratios["4x4", GUIDED] == pytest.approx(16, rel=0.1)
    assert ratios["7x7", UNDOING] == pytest.approx(1, rel=0.1)
    assert all(one.ci.lo < one.ratio < one.ci.hi for one in found)


def test_guidance_saves_steps_in_a_room() -> None:
    steps = {
        condition.method: arm(condition, condition.run(condition.batch(fast=False), range(10))).totals[STEPS]
        for condition in conditions("4", [5])
    }
    assert steps[GUIDED].mean() < steps[REWARD].mean()
