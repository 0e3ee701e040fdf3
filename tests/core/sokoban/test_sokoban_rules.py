"""Boards and the rules of one action."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfid_core.sokoban.actions import ACTIONS, DELTAS, Action
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.levels import parse_levels
from sfid_core.sokoban.lurd import to_lurd
from sfid_core.sokoban.rules import Move, step
from tests.core.sokoban.readings import from_lurd


def board(*rows: str) -> Board:
    return parse_levels("\n".join(rows))[0].start


@pytest.mark.parametrize(
    "before, action, after, moved, pushed",
    [
        ("#@ $.#", "RIGHT", "# @$.#", True, False),
        ("# @$.#", "RIGHT", "#  @*#", True, True),
        ("#@$ .#", "LEFT", "#@$ .#", False, False),
        ("#.@*$#", "RIGHT", "#.@*$#", False, False),
        ("#.@$ #", "UP", "#.@$ #", False, False),
        ("#@* $.#", "RIGHT", "# +$$.#", True, True),
        ("#.$@ #", "LEFT", "#*@  #", True, True),
        ("#$.+$#", "LEFT", "#$+.$#", True, False),
        ("#$+.$#", "LEFT", "#$+.$#", False, False),
    ],
)
def test_an_action_walks_pushes_or_is_blocked(
    before: str, action: str, after: str, *, moved: bool, pushed: bool
) -> None:
    wall = "#" * len(before)
    start = board(wall, before, wall)
    assert step(start, Action[action]) == Move(
        start.with_state(board(wall, after, wall).player, board(wall, after, wall).boxes), moved, pushed
    )


@pytest.mark.parametrize(
    "action, rows",
    [
        (Action.UP, ("#####", "# $ #", "# @.#", "#   #", "#####")),
        (Action.DOWN, ("#####", "#   #", "# @.#", "# $ #", "#####")),
    ],
)
def test_boxes_against_a_wall_are_not_pushed_up_or_down(action: Action, rows: tuple[str, ...]) -> None:
    start = board(*rows)
    assert step(start, action) == Move(start, moved=False, pushed=False)


def test_a_box_is_pushed_up_past_another_and_boxes_stay_in_order() -> None:
    start = board("#####", "#   #", "#$  #", "# $ #", "# @ #", "#.. #", "#####")
    moved = step(step(start, Action.UP).board, Action.UP).board
    assert moved.to_xsb() == "#####\n# $ #\n#$@ #\n#   #\n#   #\n#.. #\n#####"
    assert moved.boxes == (7, 11)


def test_the_actions_are_left_right_up_down_with_their_vectors() -> None:
    assert [(action.name, action.value, action.delta, action.letter) for action in ACTIONS] == [
        ("LEFT", 0, (0, -1), "l"),
        ("RIGHT", 1, (0, 1), "r"),
        ("UP", 2, (-1, 0), "u"),
        ("DOWN", 3, (1, 0), "d"),
    ]
    assert all(
        (action.opposite.delta[0] + delta[0], action.opposite.delta[1] + delta[1]) == (0, 0)
        for action, delta in zip(ACTIONS, DELTAS, strict=True)
    )


def test_a_board_is_solved_when_every_box_is_on_a_goal() -> None:
    start = board("######", "#@$.*#", "######")
    assert not start.solved
    assert step(start, Action.RIGHT).board.solved


def test_the_same_position_has_the_same_key_from_every_start() -> None:
    first = board("#######", "#@$  .#", "#######")
    second = board("#######", "# @$ .#", "#######")
    arrived = step(first, Action.RIGHT).board
    assert arrived.state_key() == second.state_key()
    assert len(arrived.state_key()) == 16
    assert arrived.level.digest != second.level.digest
    assert arrived.level.map_digest == second.level.map_digest


def test_positions_maps_and_starts_are_told_apart_but_titles_are_not() -> None:
    start = board("#######", "#@$  .#", "#     #", "#######")
    others = [step(start, action).board for action in (Action.RIGHT, Action.DOWN)]
    other_goal = board("#######", "#@$ . #", "#     #", "#######")
    keys = {place.state_key() for place in (start, *others, other_goal)}
    assert len(keys) == 4
    assert replace(start.level, title="a name", author="a person").digest == start.level.digest


@given(st.lists(st.sampled_from(ACTIONS), max_size=40))
def test_solution_letters_replay_to_the_same_board(actions: list[Action]) -> None:
    start = board("#######", "#     #", "# $   #", "#  .  #", "#     #", "#    @#", "#######")
    here = start
    pushes = 0
    for action in actions:
        here, _, pushed = step(here, action)
        pushes += pushed
    letters = to_lurd(start, actions)
    there = start
    for action in from_lurd(letters):
        there = step(there, action).board
    assert there == here
    assert sum(letter.isupper() for letter in letters) == pushes
