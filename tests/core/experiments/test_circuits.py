"""Circuits of praise: the exact bounds, and that greedy learning is trapped and cured as they say."""

import numpy as np
import pytest

from sfid_core.experiments.circuits import (
    CASES,
    OMEGAS,
    TRAPPED,
    Accepts,
    answers,
    bound,
    claims,
    conditions,
    goal_reward_min,
    share_with,
)
from sfid_core.experiments.condition import tables_of
from sfid_core.experiments.guidance import room
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.summary import Arm
from sfid_core.session.config import WorldSpec
from sfid_core.sokoban.levels import packaged

ROOM = WorldSpec(packaged("room")[0].to_xsb(), starts="all")
SMALL = WorldSpec(room(4), starts="all")


@pytest.mark.parametrize(
    "world,gamma,omega,needed",
    [
        (ROOM, 0.9, "+1/-1", 1.8),
        (ROOM, 0.9, "+1/0", 5.4),
        (ROOM, 0.9, "0/-1", 0.0),
        (ROOM, 0.99, "+1/-1", 47),
        (ROOM, 0.99, "+1/0", 73),
        (SMALL, 0.9, "+1/-1", 0.0),
        (SMALL, 0.9, "+1/0", 4.3),
        (SMALL, 0.99, "+1/-1", 22),
    ],
)
def test_the_least_goal_reward_is_what_was_found_before(
    world: WorldSpec, gamma: float, omega: str, needed: float
) -> None:
    assert goal_reward_min(tables_of(world), OMEGAS[omega], gamma) == pytest.approx(needed, abs=0.5, rel=0.01)


@pytest.mark.parametrize("accepts,share", [(Accepts.NAMED, 36 / 192), (Accepts.OPTIMAL, 20 / 192)])
def test_below_the_least_goal_reward_the_best_policy_goes_round_for_ever(
    accepts: Accepts, share: float
) -> None:
    shares = [share_with(tables_of(ROOM), (1.0, -1.0), 0.9, goal, accepts) for goal in (1.0, 2.0)]
    assert shares == [share, 1.0]


def test_a_teacher_who_names_one_action_pays_for_no_other_that_is_as_good() -> None:
    tables = tables_of(ROOM)
    state = int(np.flatnonzero(tables.optimal_mask == 0b0101)[0])
    assert answers(tables, 1.0, -1.0)[state].tolist() == [1, -1, 1, -1]
    assert answers(tables, 1.0, -1.0, Accepts.NAMED)[state].tolist() == [1, -1, -1, -1]


def test_no_circuit_can_pay_from_the_bound_on() -> None:
    assert [bound(1.0, 0.0, gamma) for gamma in (0.9, 0.95, 0.99)] == pytest.approx([9, 19, 99])
    assert bound(1.0, -1.0, 0.99) == 0.0
    assert goal_reward_min(tables_of(ROOM), (1.0, 0.0), 0.9) <= bound(1.0, 0.0, 0.9)


def test_greedy_learning_is_trapped_by_praise_and_a_larger_goal_does_not_free_it() -> None:
    cured = {"reward, step -1", "sfid, graded", "tamer"}
    success = {
        condition.method: condition.run(condition.batch(fast=False), range(2))[:, -1, 0].mean()
        for condition in conditions(ROOM)
        if condition.method in {TRAPPED, "reward, goal 100"} | cured
    }
    assert success[TRAPPED] < 0.3
    assert success["reward, goal 100"] == success[TRAPPED]
    assert min(success[name] for name in cured) > 0.85


def test_a_cure_is_claimed_where_it_solves_more_than_the_trapped_agent() -> None:
    noise = np.random.default_rng(2).random(20) / 10
    arms = [
        Arm(case.name, "t", {}, {"success_300": noise + (0.8 if case.name == "tamer" else 0.1)})
        for case in CASES
    ]
    found = claims(arms, Resampling())
    assert len(found) == sum(case.cures for case in CASES)
    assert [one.claim.partition("blames, ")[2] for one in found if one.holds] == [
        f"tamer solves more than {TRAPPED}"
    ]
