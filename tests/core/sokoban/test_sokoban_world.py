"""Episodes: where they start, what an action brings, when they end."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from sfid_core.mdp import StateOutcome, TabularMDP
from sfid_core.outcome import Outcome
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.levels import packaged, parse_levels
from sfid_core.sokoban.rules import step
from sfid_core.sokoban.solver import solve
from sfid_core.sokoban.starts import StartKind, Starts
from sfid_core.sokoban.world import Consequence, World, WorldConfig, WorldError, make_world
from tests.core.sokoban.readings import start_states

ROOM = packaged("room")[0]
SOLVED_ROOM = solve(ROOM)
CORRIDOR = parse_levels("########\n#  @$ .#\n########")[0]
REWARDS = WorldConfig(goal_reward=10.0, step_reward=-1.0, deadlock_reward=-20.0, steps_max=5)


def board(rows: str) -> Board:
    return parse_levels(rows)[0].start


@pytest.mark.parametrize(
    "rows, action, steps_done, reward, outcome, terminal",
    [
        ("########\n#  @$ .#\n########", "RIGHT", 0, -1.0, Outcome.RUNNING, False),
        ("########\n#  @$ .#\n########", "UP", 0, -1.0, Outcome.RUNNING, False),
        ("########\n#   @$.#\n########", "RIGHT", 0, 9.0, Outcome.SOLVED, True),
        ("########\n#   @$.#\n########", "RIGHT", 4, 9.0, Outcome.SOLVED, True),
        ("########\n#  @$ .#\n########", "RIGHT", 3, -1.0, Outcome.RUNNING, False),
        ("########\n#  @$ .#\n########", "RIGHT", 4, -1.0, Outcome.CAP, False),
        ("########\n#  @$ .#\n########", "UP", 4, -1.0, Outcome.CAP, False),
        ("######\n# $@.#\n#    #\n######", "LEFT", 0, -21.0, Outcome.DEADLOCK, True),
        ("######\n# $@.#\n#    #\n######", "LEFT", 4, -21.0, Outcome.DEADLOCK, True),
    ],
)
def test_a_step_pays_and_ends_as_configured(
    rows: str, action: str, steps_done: int, reward: float, outcome: Outcome, *, terminal: bool
) -> None:
    start = board(rows)
    done = World(start.level, REWARDS, "1", 0).execute(start, Action[action], steps_done)
    assert done == Consequence(step(start, Action[action]).board, reward, outcome)
    assert done.terminal is terminal


def test_a_level_too_large_to_solve_is_played_with_provable_deadlocks_only() -> None:
    start = board("######\n# $@.#\n#    #\n######")
    world = World(start.level, WorldConfig(states_max=10), "1", 0)
    assert world.solution is None
    assert (world.optimal_steps(start), world.optimal_actions(start)) == (None, ())
    assert world.begin(3) == start
    assert world.execute(start, Action.LEFT, 0).outcome is Outcome.DEADLOCK
    assert world.execute(start, Action.DOWN, 0).outcome is Outcome.RUNNING
    with pytest.raises(WorldError, match='use starts "1"'):
        World(start.level, WorldConfig(states_max=10), "4", 0).begin(0)


def test_every_step_of_a_shortest_solution_comes_nearer_and_the_last_is_paid() -> None:
    world = World(ROOM, WorldConfig(), "1", 0)
    here = world.begin(0)
    rewards: list[float] = []
    left: list[int | None] = []
    while not here.solved:
        left.append(world.optimal_steps(here))
        done = world.execute(here, world.optimal_actions(here)[-1], len(rewards))
        rewards.append(done.reward)
        here = done.board
    assert left == list(range(11, 0, -1))
    assert rewards == [0.0] * 10 + [10.0]
    assert (world.optimal_steps(here), world.optimal_actions(here)) == (0, ())


def test_fixed_starts_are_the_level_s_own() -> None:
    world = World(ROOM, WorldConfig(), "1", 5)
    assert [world.begin(episode) for episode in (0, 1, 17)] == [ROOM.start] * 3


def test_each_block_of_episodes_visits_each_start_once_in_an_order_of_its_own() -> None:
    world = World(ROOM, WorldConfig(), "6", 5)
    starts = start_states(ROOM, SOLVED_ROOM, Starts(StartKind.SAMPLE, count=6), 1)
    blocks = [tuple(world.begin(6 * block + place) for place in range(6)) for block in range(20)]
    assert {frozenset(block) for block in blocks} == {frozenset(blocks[0])}
    assert len(set(blocks[0])) == len(starts) == 6
    assert ROOM.start in blocks[0]
    assert len(set(blocks)) > 10


def test_starts_depend_on_the_seed_and_not_on_the_order_of_calls() -> None:
    def orders(seed: int, episodes: range) -> list[Board]:
        world = World(ROOM, WorldConfig(), "5", seed)
        return [world.begin(episode) for episode in episodes]

    assert orders(1, range(10)) == orders(1, range(9, -1, -1))[::-1]
    assert orders(1, range(10)) != orders(2, range(10))


def test_all_starts_are_drawn_evenly_from_every_state_that_can_be_solved() -> None:
    world = World(ROOM, WorldConfig(), "all", 5)
    counts = Counter(world.begin(episode) for episode in range(19_200))
    assert len(counts) == 192
    assert all(60 < count < 150 for count in counts.values())
    assert set(counts) == {SOLVED_ROOM.table.board(state) for state in SOLVED_ROOM.solvable_states()}


def test_starts_within_a_distance_are_all_of_them() -> None:
    near = start_states(ROOM, SOLVED_ROOM, Starts.parse("within:3"), 0)
    assert {SOLVED_ROOM.distance(place) for place in near} == {1, 2, 3}
    assert len(near) == sum(
        1 <= int(SOLVED_ROOM.steps[state]) <= 3 for state in SOLVED_ROOM.solvable_states()
    )


def test_a_sample_can_be_every_state_there_is() -> None:
    everything = start_states(ROOM, SOLVED_ROOM, Starts.parse("192"), 3)
    assert everything[0] == ROOM.start
    assert set(everything) == set(start_states(ROOM, SOLVED_ROOM, Starts.parse("all"), 3))


@pytest.mark.parametrize(
    "text, starts",
    [
        ("1", Starts(StartKind.FIXED)),
        ("4", Starts(StartKind.SAMPLE, count=4)),
        ("all", Starts(StartKind.ALL)),
        ("within:12", Starts(StartKind.WITHIN, distance=12)),
    ],
)
def test_starts_are_read_from_text(text: str, starts: Starts) -> None:
    assert Starts.parse(text) == starts


@pytest.mark.parametrize(
    "rows, starts, complaint",
    [
        ("room", "0", 'starts \'0\' is unknown; use "1", a number of starts, "all" or "within:STEPS"'),
        ("room", "193", "starts: 193 asked for, but the level has only 192 that can be solved"),
        ("######\n#@*  #\n######", "1", "the level is solved at its start; move a box off its goal"),
        (
            "######\n#$@. #\n######",
            "1",
            'the level cannot be solved from its own start; move a box, or use starts "all"',
        ),
        (
            "######\n#$@. #\n#$ . #\n######",
            "all",
            "",
        ),
        (
            "########\n#@$.#$ #\n#  .####\n########",
            "all",
            "the level has no start that can be solved; check its walls, boxes and goals",
        ),
    ],
)
def test_starts_that_cannot_be_had_are_refused(rows: str, starts: str, complaint: str) -> None:
    text = ROOM.to_xsb() if rows == "room" else rows
    if not complaint:
        assert make_world(text, WorldConfig(), starts, 0).begin(0).solved is False
        return
    with pytest.raises(WorldError) as caught:
        make_world(text, WorldConfig(), starts, 0).begin(0)
    assert str(caught.value) == complaint


@pytest.mark.parametrize(
    "fields, complaint",
    [
        ({"goal_reward": float("nan")}, "goal_reward is nan; give a finite number"),
        ({"deadlock_reward": float("-inf")}, "deadlock_reward is -inf; give a finite number"),
        ({"steps_max": 0}, "steps_max is 0; give at least 1"),
        ({"states_max": -3}, "states_max is -3; give at least 1"),
    ],
)
def test_a_configuration_that_makes_no_sense_is_refused(fields: dict[str, Any], complaint: str) -> None:
    with pytest.raises(WorldError) as caught:
        WorldConfig(**fields)
    assert str(caught.value) == complaint


SUCCESSOR = np.array([[1, 0], [1, 1]], dtype=np.int32)
REWARD = np.array([[1.0, 0.0], [0.0, 0.0]])
OUTCOME = np.array([StateOutcome.RUNNING, StateOutcome.SOLVED], dtype=np.uint8)


@pytest.mark.parametrize(
    "tables, complaint",
    [
        ((SUCCESSOR.astype(np.int64), REWARD, OUTCOME), "successor is int64 with 2 axes; give int32 with 2"),
        ((SUCCESSOR, REWARD[0], OUTCOME), "reward is float64 with 1 axes; give float64 with 2"),
        ((SUCCESSOR, REWARD, OUTCOME[:0]), "outcome is empty; give at least one state and one action"),
        (
            (SUCCESSOR, REWARD, OUTCOME[:1]),
            "tables disagree: successor (2, 2), reward (2, 2), outcome (1,); give [n, k], [n, k] and [n]",
        ),
        ((SUCCESSOR + np.int32(1), REWARD, OUTCOME), "successor is outside 0..1, first in state 0"),
        ((SUCCESSOR, REWARD * np.nan, OUTCOME), "reward is not finite, first in state 0"),
        ((SUCCESSOR, REWARD, OUTCOME * np.uint8(3)), "outcome is none of 0, 1 and 2, first in state 1"),
        (
            (SUCCESSOR, REWARD, OUTCOME[::-1].copy()),
            "a terminal state does not lead to itself, first in state 0",
        ),
        ((SUCCESSOR, REWARD + 1, OUTCOME), "a terminal state pays a reward, first in state 1"),
    ],
)
def test_tables_that_are_no_world_are_refused(tables: tuple[Any, Any, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=r".") as caught:
        TabularMDP(*tables)
    assert str(caught.value) == complaint


def test_a_world_s_tables_cannot_be_changed() -> None:
    mdp = TabularMDP(SUCCESSOR.copy(), REWARD.copy(), OUTCOME.copy())
    assert (mdp.n_states, mdp.n_actions) == (2, 2)
    with pytest.raises(ValueError, match="read-only"):
        mdp.reward[0, 0] = 5.0
