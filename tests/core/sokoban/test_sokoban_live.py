"""Compact tables: the same world as the boards say, under fewer numbers."""

from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sfid_core.mdp import StateOutcome
from sfid_core.outcome import Outcome
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.levels import load_bytes, packaged, parse_levels
from sfid_core.sokoban.live import WorldTables, tabulate
from sfid_core.sokoban.starts import Starts
from sfid_core.sokoban.world import World, WorldConfig, WorldError

BOXOBAN = Path(__file__).resolve().parents[4] / "shared" / "data" / "boxoban-test-100.txt"
ROOM = packaged("room")[0]
OUTCOMES = {
    Outcome.RUNNING: StateOutcome.RUNNING,
    Outcome.CAP: StateOutcome.RUNNING,
    Outcome.SOLVED: StateOutcome.SOLVED,
    Outcome.DEADLOCK: StateOutcome.DEADLOCK,
}
STARTS = ("1", "3", "all", "within:3")
LEVELS = {
    **{level.title: level for level in (ROOM, *packaged("classroom")[:6])},
    "walled-in box": parse_levels("########\n#@$ .#*#\n#    ###\n########")[0],
}
CONFIG = WorldConfig(goal_reward=7.0, step_reward=-0.3, deadlock_reward=-3.1)


def reached(world: World) -> set[Board]:
    """Every position an episode from the level's own start can be in, by the rules alone."""
    seen = {world.level.start}
    queue = deque(seen)
    while queue:
        board = queue.popleft()
        for action in ACTIONS:
            done = world.execute(board, action, 0)
            if done.outcome is not Outcome.DEADLOCK and done.board not in seen:
                seen.add(done.board)
                if done.outcome is not Outcome.SOLVED:
                    queue.append(done.board)
    return seen


def differences(world: World, tables: WorldTables) -> list[str]:
    """Name every state in which the tables and the world part."""
    found = []
    for state in range(tables.sink):
        board = tables.board(state)
        if tables.state_id(board) != state or tables.state_keys[state] != board.state_key():
            found.append(f"{state}: names")
        if int(tables.optimal_steps[state]) != world.optimal_steps(board):
            found.append(f"{state}: steps")
        named = tuple(action for action in ACTIONS if tables.optimal_mask[state] >> action & 1)
        if named != world.optimal_actions(board):
            found.append(f"{state}: optimal")
        for action in ACTIONS:
            after = int(tables.successor[state, action])
            if board.solved:
                expected = (board, 0.0, StateOutcome.SOLVED)
            else:
                done = world.execute(board, action, 0)
                expected = (done.board, done.reward, OUTCOMES[done.outcome])
            there = expected[0] if after == tables.sink else tables.board(after)
            if (there, float(tables.reward[state, action]), tables.outcome[after]) != expected:
                found.append(f"{state}, {action.name}: transition")
    return found


@pytest.mark.parametrize("starts", STARTS)
@pytest.mark.parametrize("name", LEVELS)
def test_the_tables_say_in_every_live_state_what_the_world_does(name: str, starts: str) -> None:
    world = World(LEVELS[name], CONFIG, starts, 5)
    tables = tabulate(world)
    assert differences(world, tables) == []
    if starts == "1":
        assert {tables.board(state) for state in range(tables.sink)} == reached(world)
    else:
        assert world.solution is not None
        assert tables.sink == int((world.solution.steps >= 0).sum())


@pytest.mark.parametrize("starts", STARTS)
@pytest.mark.parametrize("seed", [0, 41])
def test_every_seed_draws_from_the_tables_the_starts_of_its_own_world(starts: str, seed: int) -> None:
    tables = tabulate(World(ROOM, CONFIG, starts, 1))
    drawn = tables.draw_starts(seed)
    world = World(ROOM, CONFIG, starts, seed)
    assert [tables.board(state) for state in drawn.starts(40).tolist()] == [world.begin(n) for n in range(40)]
    assert [drawn.start(episode) for episode in range(40)] == drawn.starts(40).tolist()


@pytest.mark.parametrize("starts", ["1", "2", "4", "64", "100", "192", "all", "within:1", "within:9"])
@pytest.mark.parametrize("episodes", [1, 30, 130])
def test_many_seeds_at_once_draw_the_starts_that_each_draws_alone(starts: str, episodes: int) -> None:
    tables = tabulate(World(ROOM, CONFIG, starts, 1))
    seeds = [0, 1, 7, 2**53 - 1]
    alone = np.array([tables.draw_starts(seed).starts(episodes) for seed in seeds])
    together = tables.starts_of(seeds, episodes)
    assert (together.dtype, together.shape) == (np.dtype(np.int32), (4, episodes))
    assert (together == alone).all()
    assert tables.starts_of([], episodes).shape == (0, episodes)


def test_the_sink_is_the_last_state_and_stands_for_whatever_is_not_live() -> None:
    tables = tabulate(World(ROOM, CONFIG, "all", 0))
    corner = ROOM.start.with_state(ROOM.player, (8,))
    assert (tables.n_states, tables.sink, tables.state_id(corner)) == (217, 216, 216)
    assert np.bincount(tables.outcome).tolist() == [192, 24, 1]
    assert tables.successor[tables.sink].tolist() == [tables.sink] * 4
    assert (tables.optimal_steps[tables.sink], tables.optimal_mask[tables.sink]) == (-1, 0)
    assert not tables.reward[tables.sink].any()
    for name in (tables.board, tables.state_key):
        with pytest.raises(ValueError, match=r"^state 216 is no live state; give 0 to 215$"):
            name(216)


def test_the_arrays_have_the_promised_types_make_an_mdp_and_cannot_be_changed() -> None:
    tables = tabulate(World(ROOM, CONFIG, "1", 0))
    forms = {
        name: (str(table.dtype), table.shape)
        for name, table in vars(tables).items()
        if isinstance(table, np.ndarray)
    }
    n = tables.n_states
    assert forms == {
        "successor": ("int32", (n, 4)),
        "reward": ("float64", (n, 4)),
        "outcome": ("uint8", (n,)),
        "optimal_steps": ("int32", (n,)),
        "optimal_mask": ("uint8", (n,)),
        "placements": ("int16", (n - 1, 2)),
    }
    assert (tables.mdp.n_states, tables.mdp.n_actions) == (n, 4)
    with pytest.raises(ValueError, match="read-only"):
        tables.optimal_mask[0] = 1


@pytest.mark.parametrize(
    "rows, starts, states_max, complaint",
    [
        ("######\n#$ @.#\n######", "1", 100, "cannot be solved from its own start"),
        ("######\n# @* #\n######", "1", 100, "the level is solved at its start; move a box off its goal"),
        ("#####\n#@ $#\n#. ##\n#####", "all", 100, "no start that can be solved"),
        (ROOM.to_xsb(), "1", 624, "the level has 625 states, more than the 624 that are solved exactly"),
        (ROOM.to_xsb(), "500", 625, "500 asked for, but the level has only 192 that can be solved"),
    ],
)
def test_a_world_without_tables_is_refused_with_its_reason(
    rows: str, starts: str, states_max: int, complaint: str
) -> None:
    world = World(parse_levels(rows)[0], WorldConfig(states_max=states_max), starts, 0)
    with pytest.raises(WorldError, match=complaint):
        tabulate(world)


def test_a_sample_larger_than_the_level_is_refused_for_many_seeds_too() -> None:
    tables = replace(tabulate(World(ROOM, CONFIG, "4", 0)), starts=Starts.parse("193"))
    with pytest.raises(WorldError, match="193 asked for, but the level has only 192 that can be solved"):
        tables.starts_of([0, 1], 30)


@pytest.mark.skipif(not BOXOBAN.exists(), reason="the Boxoban test levels are not on this machine")
@pytest.mark.parametrize("index", [3, 17])
def test_boxoban_levels_shrink_to_what_their_start_leads_to(index: int) -> None:
    world = World(load_bytes(BOXOBAN.read_bytes(), BOXOBAN.name)[index], CONFIG, "1", 0)
    assert world.solution is not None
    tables = tabulate(world)
    assert tables.n_states < world.solution.table.n_states / 5
    state, steps = tables.draw_starts(0).start(0), 0
    assert tables.board(state) == world.level.start
    while mask := int(tables.optimal_mask[state]):
        state = int(tables.successor[state, mask.bit_length() - 1])
        steps += 1
    assert (steps, tables.outcome[state]) == (world.optimal_steps(world.level.start), StateOutcome.SOLVED)
