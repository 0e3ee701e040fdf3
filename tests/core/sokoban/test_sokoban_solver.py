"""State tables, exact distances and sound deadlocks, against brute force that shares no code with them."""

import tracemalloc
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from sfid_core.sokoban.actions import ACTIONS, Action
from sfid_core.sokoban.board import Board, Level
from sfid_core.sokoban.deadlock import surely_deadlocked
from sfid_core.sokoban.levels import load_bytes, packaged, parse_levels
from sfid_core.sokoban.rules import step
from sfid_core.sokoban.solver import Solution, solve
from sfid_core.sokoban.tables import TooManyStates, build_table, count_states
from tests.core.sokoban.readings import positions

BOXOBAN = Path(__file__).resolve().parents[4] / "shared" / "data" / "boxoban-test-100.txt"

ROOM = packaged("room")[0]
SMALL = {
    "corridor": "#######\n#@ $ .#\n#######",
    "corner": "######\n#@$  #\n#  . #\n######",
    "two boxes": "#######\n#@ $ .#\n#  $  #\n#    .#\n#######",
    "pillar": "#######\n#.   .#\n# $#$ #\n#  @  #\n#######",
    "three boxes": "######\n#@.. #\n# $$ #\n#  $.#\n######",
    "a box out of reach on its goal": "#########\n#@ $ .#*#\n#     ###\n#######  ",
    "a box out of reach off its goal": "#########\n#@ $ .#$#\n#    .###\n#######  ",
}


def drawn(name: str) -> Level:
    return parse_levels(SMALL[name])[0]


def xsb_moves(rows: str) -> set[str]:
    """Return what one action makes of a drawing, by moving glyphs about: the slow oracle of the rules."""
    width = rows.index("\n") + 1
    here = next(index for index, glyph in enumerate(rows) if glyph in "@+")
    after = {rows}
    for stride in (-1, 1, -width, width):
        glyphs = list(rows)
        one, two = here + stride, here + 2 * stride
        if glyphs[one] in "$*":
            if glyphs[two] not in " .":
                continue
            glyphs[two] = {" ": "$", ".": "*"}[glyphs[two]]
            glyphs[one] = {"$": " ", "*": "."}[glyphs[one]]
        if glyphs[one] not in " .":
            continue
        glyphs[one] = {" ": "@", ".": "+"}[glyphs[one]]
        glyphs[here] = {"@": " ", "+": "."}[glyphs[here]]
        after.add("".join(glyphs))
    return after


def placements(level: Level) -> list[Board]:
    """Return every position with the reachable boxes anywhere within the player's reach."""
    outside = [box for box in level.boxes if box not in level.reach]
    inside = len(level.boxes) - len(outside)
    return [
        level.start.with_state(player, (*boxes, *outside))
        for boxes in combinations(level.reach, inside)
        for player in level.reach
        if player not in boxes
    ]


def brute_force(level: Level) -> dict[str, int]:
    """Return the fewest steps to solved of every drawing that can be solved, by relaxing."""
    after = {board.to_xsb(): xsb_moves(board.to_xsb()) for board in placements(level)}
    steps = {rows: 0 for rows in after if "$" not in rows}
    changed = True
    while changed:
        changed = False
        for rows, next_rows in after.items():
            best = min((steps[place] + 1 for place in next_rows if place in steps), default=None)
            if best is not None and best < steps.get(rows, best + 1):
                steps[rows] = best
                changed = True
    return steps


@pytest.mark.parametrize("name", SMALL)
def test_exact_distances_are_those_of_brute_force(name: str) -> None:
    level = drawn(name)
    expected = brute_force(level)
    solution = solve(level)
    found = {board.to_xsb(): solution.distance(board) for board in placements(level)}
    assert found == {rows: expected.get(rows) for rows in found}
    assert solution.longest == max(expected.values(), default=0)
    assert len(solution.solvable_states()) == sum(steps > 0 for steps in expected.values())


def test_the_room_has_576_unsolved_states_of_which_192_can_be_solved_in_at_most_11_steps() -> None:
    """576 = 24 box cells off the goal x 24 player cells off the box; 24 more states are solved."""
    expected = brute_force(ROOM)
    unsolved = [board for board in placements(ROOM) if not board.solved]
    solution = solve(ROOM)
    assert (len(unsolved), len(placements(ROOM))) == (576, 600)
    assert (solution.table.n_states, int(positions(solution.table).sum())) == (625, 600)
    assert len(solution.solvable_states()) == sum(steps > 0 for steps in expected.values()) == 192
    assert solution.longest == max(expected.values()) == 11


@pytest.mark.parametrize("name", SMALL)
def test_the_table_follows_the_rules_in_every_state(name: str) -> None:
    table = build_table(drawn(name))
    states = np.flatnonzero(positions(table))
    assert len(states) == len(placements(table.level))
    for state in states.tolist():
        board = table.board(state)
        assert table.state_id(board) == state
        expected = [table.state_id(step(board, action).board) for action in ACTIONS]
        assert table.successor[state].tolist() == expected
    assert (table.successors(states) == table.successor[states]).all()
    holes = np.flatnonzero(~positions(table))
    assert (table.successor[holes] == holes[:, np.newaxis]).all()


def test_optimal_actions_are_all_that_come_one_step_nearer() -> None:
    solution = solve(ROOM)
    expected = brute_force(ROOM)
    for board in placements(ROOM):
        steps = expected.get(board.to_xsb())
        nearer = tuple(
            action
            for action in ACTIONS
            if steps and expected.get(step(board, action).board.to_xsb()) == steps - 1
        )
        assert solution.optimal_actions(board) == nearer
        assert solution.deadlocked(board) == (steps is None)


@pytest.mark.parametrize("level", packaged("classroom"), ids=lambda level: level.title)
def test_a_solution_solves_in_the_exact_number_of_steps(level: Level) -> None:
    solution = solve(level)
    actions = solution.solution(level.start)
    board = level.start
    for action in actions:
        assert not board.solved
        board = step(board, action).board
    assert board.solved
    assert len(actions) == solution.distance(level.start)


def test_a_deadlocked_position_has_no_distance_and_no_actions() -> None:
    solution = solve(ROOM)
    corner = ROOM.start.with_state(ROOM.player, (8,))
    assert (solution.distance(corner), solution.deadlocked(corner)) == (None, True)
    assert solution.optimal_actions(corner) == ()
    with pytest.raises(ValueError, match="cannot be solved"):
        solution.solution(corner)


@pytest.mark.parametrize(
    "player, boxes, complaint",
    [
        (0, (16,), "no reachable floor"),
        (40, (0,), "no reachable floor"),
        (16, (16,), "no position of this level with its 1 boxes"),
        (40, (16, 17), "no position of this level with its 1 boxes"),
        (40, (), "no position of this level with its 1 boxes"),
    ],
)
def test_a_board_that_is_no_position_of_the_level_is_refused(
    player: int, boxes: tuple[int, ...], complaint: str
) -> None:
    with pytest.raises(ValueError, match=complaint):
        build_table(ROOM).state_id(ROOM.start.with_state(player, boxes))


@pytest.mark.parametrize("state", [-1, 625, 0])
def test_an_id_that_is_no_position_is_refused(state: int) -> None:
    with pytest.raises(ValueError, match=f"^state {state} is no position of this level$"):
        build_table(ROOM).board(state)


def test_a_level_with_too_many_states_is_refused_with_number_limit_and_what_is_left() -> None:
    assert count_states(ROOM) == 625
    with pytest.raises(TooManyStates) as caught:
        solve(ROOM, states_max=624)
    assert str(caught.value) == (
        "the level has 625 states, more than the limit of 624; it can be played and taught, "
        "but without the optimal teacher, exact deadlocks and drawn starts"
    )
    row = "#" + " " * 60 + "#\n"
    hall = parse_levels("#" * 62 + "\n#@" + "$" * 29 + "." * 30 + "#\n#$" + row[2:] + row * 50 + "#" * 62)[0]
    with pytest.raises(
        TooManyStates, match=r"^the level has about 10\^\d+ states, more than the limit of 12,000,000;"
    ):
        solve(hall)


@pytest.mark.parametrize(
    "level", [ROOM, *map(drawn, SMALL), *packaged("classroom")], ids=lambda level: level.title
)
def test_what_is_called_surely_deadlocked_is_deadlocked(level: Level) -> None:
    solution = solve(level)
    states = np.flatnonzero(positions(solution.table))[:: max(1, solution.table.n_states // 4000)]
    boards = [solution.table.board(state) for state in states]
    called = [board for board in boards if surely_deadlocked(board)]
    assert [board.to_xsb() for board in called if not solution.deadlocked(board)] == []
    dead = [board for board in boards if solution.deadlocked(board)]
    # Sound alone would be met by never saying yes. In a corridor a player on the wrong side goes unseen.
    assert len(called) >= 0.4 * len(dead)


@pytest.mark.parametrize(
    "rows, dead",
    [
        ("######\n#$ @.#\n######", True),
        ("#######\n# @  .#\n#$    #\n#######", True),
        ("#######\n#     #\n# $$@ #\n# $$..#\n#   ..#\n#######", True),
        ("#######\n#     #\n# **@ #\n# *$. #\n#######", True),
        ("#######\n#     #\n# **@ #\n#  $. #\n#######", False),
        ("#######\n#     #\n# $ @ #\n#  .  #\n#     #\n#######", False),
        ("######\n#@$ .#\n######", False),
        ("######\n#@*  #\n######", False),
    ],
)
def test_dead_cells_and_frozen_boxes_are_seen(rows: str, *, dead: bool) -> None:
    assert surely_deadlocked(parse_levels(rows)[0].start) == dead


def test_twelve_million_states_would_be_solved_within_250_megabytes() -> None:
    rows = [
        "##########",
        "#@       #",
        "# $ $    #",
        "# . . .  #",
        "#   $    #",
        *["#        #"] * 3,
        "##########",
    ]
    level = parse_levels("\n".join(rows))[0]
    n_states = count_states(level)
    tracemalloc.start()
    try:
        solution = solve(level)
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (solution.table.n_states, n_states) == (1_552_320, 1_552_320)
    assert 12_000_000 * peak_bytes / n_states < 250e6


@pytest.mark.skipif(not BOXOBAN.exists(), reason="the Boxoban test levels are not on this machine")
def test_boxoban_levels_are_solved_and_their_solutions_replay() -> None:
    levels = sorted(load_bytes(BOXOBAN.read_bytes(), BOXOBAN.name), key=count_states)[:12]
    for level in levels:
        solution: Solution = solve(level)
        board = level.start
        actions: tuple[Action, ...] = solution.solution(board)
        for action in actions:
            board = step(board, action).board
        assert board.solved
        generator = np.random.default_rng(0)
        for state in generator.choice(np.flatnonzero(positions(solution.table)), 300, replace=False):
            place = solution.table.board(state)
            assert not (surely_deadlocked(place) and not solution.deadlocked(place))
