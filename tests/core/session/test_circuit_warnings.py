"""Warnings at configuration: praise that can outweigh the goal, dying that pays, and neither."""

from collections.abc import Mapping

import pytest

from sfid_core.learning.parameters import Value
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.session.warnings import circuit_warnings


def warned(
    method: str = "sfid",
    given: Mapping[str, Value] | None = None,
    goal: float = 10.0,
    step: float = 0.0,
    deadlock: float = -10.0,
) -> tuple[str, ...]:
    world = WorldSpec("", goal_reward=goal, step_reward=step, deadlock_reward=deadlock)
    return circuit_warnings(SessionConfig("s1", world, method, given or {}))


def test_the_defaults_have_nothing_to_warn_of() -> None:
    assert warned() == ()


@pytest.mark.parametrize("method", ["sfid", "reward", "guidance"])
def test_praise_that_can_outweigh_the_goal_is_warned_of_with_the_cure(method: str) -> None:
    (line,) = warned(method, {"gamma": 0.95})
    assert line.startswith(f"method {method} with goal reward 10 and gamma 0.95: praise for walking round")
    assert "which needs 19; use a goal reward of 19 or more, gamma up to 0.9, a step reward of -1, or" in line


def test_following_a_cure_ends_the_warning() -> None:
    assert warned("sfid", {"gamma": 0.95}, goal=19.1) == ()
    assert warned("sfid", {"gamma": 0.95}, step=-1.0, deadlock=-20.0) == ()
    assert warned("sfid", {"gamma": 0.95, "omega": "penalty"}) == ()
    assert warned("sfid", {"gamma": 0.9}) == ()


@pytest.mark.parametrize(
    "method,given",
    [("tamer", {}), ("advise", {}), ("coach", {}), ("dagger", {}), ("q-learning", {}), ("tamer-rl", {})],
)
def test_methods_that_keep_praise_out_of_their_values_are_not_warned_of(
    method: str, given: Mapping[str, Value]
) -> None:
    assert warned(method, {**given, "gamma": 0.99}) == ()


def test_the_weight_of_the_teachers_model_counts() -> None:
    (line,) = warned("tamer-rl", {"technique": "reward-shaping", "weight": 3.0})
    assert "which needs 27" in line
    assert "-p technique=action-biasing" in line


def test_dying_that_pays_is_warned_of_with_the_cure() -> None:
    (line,) = warned("q-learning", {}, step=-1.0, deadlock=0.0)
    assert line == (
        "step reward -1 and deadlock reward 0: dying costs less than walking on (-10 at gamma 0.9), "
        "so without a teacher it pays; use a deadlock reward of -10 or less"
    )
    assert warned("q-learning", {}, step=-1.0, deadlock=-10.0001) == ()


def test_where_rewards_can_only_be_scaled_the_scale_is_advised_and_no_flag_that_is_not_there() -> None:
    world = WorldSpec("", goal_reward=1.0, step_reward=0.0)
    (line,) = circuit_warnings(SessionConfig("s1", world), scale=1.0, sets_parameters=False)
    assert line.endswith(
        "which needs 9; use `--reward-scale 9` or more or a method that keeps praise out of its values "
        "(`--method tamer`)"
    )


@pytest.mark.parametrize("step,scale,advised", [(0.0, 1.0, 9.0), (0.0, 0.5, 4.5), (-0.05, 2.0, 12.42)])
def test_the_scale_that_is_advised_ends_the_warning_and_a_hundredth_less_does_not(
    step: float, scale: float, advised: float
) -> None:
    def lines(factor: float) -> tuple[str, ...]:
        by = factor / scale
        world = WorldSpec("", goal_reward=by, step_reward=step * by)
        return circuit_warnings(SessionConfig("s1", world), scale=factor)

    assert f"use `--reward-scale {advised:g}` or more, gamma" in lines(scale)[0]
    assert lines(advised) == ()
    assert len(lines(advised - 0.01)) == 1
