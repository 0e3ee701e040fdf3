"""The search from one start finds what the table of all positions says."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sfid_core.sokoban.board import Level
from sfid_core.sokoban.generator import Recipe, generate
from sfid_core.sokoban.levels import load_bytes, packaged, parse_levels
from sfid_core.sokoban.rules import step
from sfid_core.sokoban.search import shortest
from sfid_core.sokoban.solver import solve
from sfid_core.sokoban.tables import TooManyStates
from tests.core.sokoban.readings import positions

BOXOBAN = Path(__file__).resolve().parents[4] / "shared" / "data" / "boxoban-test-100.txt"
DRAWN = {
    "unsolvable": "######\n#$ @.#\n######",
    "solved at its start": "######\n#@ * #\n######",
    "box in a corner": "#####\n#@ $#\n#. ##\n#####",
    "walled-in box on its goal": "########\n#@$ .#*#\n#    ###\n########",
    "walled-in box off its goal": "########\n#@$ .#$#\n#    #.#\n########",
    "walled-in goal": "########\n#@$ $#.#\n#  . ###\n########",
}


def found(level: Level) -> int | None:
    """Return the length of the way found, after walking it."""
    actions = shortest(level)
    if actions is None:
        return None
    board = level.start
    for action in actions:
        assert not board.solved
        board = step(board, action).board
    assert board.solved
    return len(actions)


@pytest.mark.parametrize("name", ["room", "classroom", "two-boxes", "three-boxes"])
def test_packaged_levels_take_as_many_steps_as_the_table_says(name: str) -> None:
    levels = packaged(name)
    assert [found(level) for level in levels] == [solve(level).distance(level.start) for level in levels]


@pytest.mark.parametrize("name", DRAWN)
def test_odd_levels_are_judged_as_the_table_judges_them(name: str) -> None:
    level = parse_levels(DRAWN[name])[0]
    assert found(level) == solve(level).distance(level.start)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32), st.integers(1, 3), st.data())
def test_any_position_of_a_drawn_room_takes_as_many_steps_as_the_table_says(
    seed: int, boxes: int, data: st.DataObject
) -> None:
    level = next(generate(Recipe(7, 6, boxes, 1), seed))
    solution = solve(level)
    state = data.draw(
        st.integers(0, solution.table.n_states - 1).filter(lambda n: positions(solution.table)[n])
    )
    board = solution.table.board(state)
    moved = Level(level.width, level.height, level.walls, level.goals, board.player, board.boxes)
    assert found(moved) == solution.distance(board)


def test_what_is_not_found_in_time_is_said_with_the_mend() -> None:
    level = packaged("three-boxes")[2]
    with pytest.raises(TooManyStates) as caught:
        shortest(level, seen_max=500)
    assert str(caught.value).startswith("the level is not solved in ")
    assert str(caught.value).endswith(" steps, after 500 positions; take away a box or some floor")


@pytest.mark.skipif(not BOXOBAN.exists(), reason="the Boxoban test levels are not on this machine")
def test_boxoban_levels_take_as_many_steps_as_the_table_says() -> None:
    levels = load_bytes(BOXOBAN.read_bytes(), BOXOBAN.name)[:10]
    assert [found(level) for level in levels] == [solve(level).distance(level.start) for level in levels]
