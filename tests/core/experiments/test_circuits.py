"""Circuits of praise: the exact bounds, and that greedy learning is trapped and cured as they say."""

import numpy as np
import pytest

from sfid_core.experiments.circuits import (
    CASES,
    OMEGAS,
    TRAPPED,
    answers,
    best_values,
    bound,
    claims,
    conditions,
    finishing_share,
    goal_reward_min,
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


def test_below_the_least_goal_reward_the_best_policy_goes_round_for_ever() -> None:
    tables = tables_of(ROOM)
    pays = (tables.outcome[tables.successor] == 1) & (tables.outcome == 0)[:, np.newaxis]
    paid = answers(tables, 1.0, -1.0)
    shares = [finishing_share(tables, best_values(tables, paid + goal * pays, 0.9)) for goal in (1.0, 2.0)]
    assert shares[0] < 0.5
    assert shares[1] == 1.0


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
