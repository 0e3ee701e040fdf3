"""`sfid levels`: its documents, its lines and its exit codes."""

import json
from collections.abc import Container
from pathlib import Path
from typing import Any

import pytest

from sfid_core.sokoban.levels import load_bytes, packaged, parse_levels
from sfid_core.sokoban.lurd import to_lurd
from sfid_core.sokoban.rules import step
from tests.core.sokoban.readings import from_lurd
from tests.services.cli.command_line import Done, sfid

pytestmark = pytest.mark.real
BOXOBAN = Path(__file__).resolve().parents[4] / "shared" / "data" / "boxoban-test-100.txt"
CORRIDOR = "######\n#@$ .#\n######\nTitle: corridor\n"
STUCK = "######\n#$ @.#\n######\n"
NO_BOX = "####\n#@.#\n####\n"
UNKNOWN = "#####\n#@X.#\n#####\n"
HALL = "\n".join(
    ["##########", "#@       #", "# $ $ $  #", "# .....  #", "#  $ $   #", *["#        #"] * 3, "##########"]
)

VAST = "\n".join(
    [
        "##############",
        "#@           #",
        "# $ $ $ $ $  #",
        "# .........  #",
        "#  $ $ $ $   #",
        *["#            #"] * 4,
        "##############",
    ]
)


def document(*arguments: str, code: int = 0) -> tuple[Any, str]:
    """Return the JSON document of a command and what it said on stderr."""
    done = sfid("levels", *arguments, "--json")
    assert done.code == code, done
    return json.loads(done.stdout), done.stderr


def written(folder: Path, *levels: str) -> str:
    path = folder / "levels.xsb"
    path.write_text("\n".join(levels))
    return str(path)


def test_check_tells_of_every_level_of_a_file_what_was_promised() -> None:
    rows, said = document("check", "classroom")
    steps, states = [2, 6, 9, 12, 17, 24, 35], [16, 225, 484, 5082, 3249, 3800, 229_075]
    assert said == ""
    assert rows == [
        {"index": index, "width": level.width, "height": level.height, "boxes": len(level.boxes),
         "solvable": True, "optimal_steps": steps[index], "states": states[index]}
        for index, level in enumerate(packaged("classroom"))
    ]  # fmt: skip


def test_check_of_one_level_keeps_its_number(tmp_path: Path) -> None:
    rows, said = document("check", f"{written(tmp_path, STUCK, CORRIDOR)}:1")
    assert said == ""
    assert rows == [{"index": 1, "width": 6, "height": 3, "boxes": 1, "solvable": True, "optimal_steps": 2,
                     "states": 16}]  # fmt: skip


def test_a_level_without_solution_is_exit_1_and_named(tmp_path: Path) -> None:
    path = written(tmp_path, CORRIDOR, STUCK)
    for verb in ("check", "solve"):
        rows, said = document(verb, path, code=1)
        assert [(row["solvable"], row["optimal_steps"]) for row in rows] == [(True, 2), (False, None)]
        assert [row.get("lurd") for row in rows] == (["RR", None] if verb == "solve" else [None, None])
        assert said == (
            f"sfid: 1 of 2 levels ({path}:1) cannot be solved: no sequence of actions does it; "
            "move a box, a goal or a wall\n"
        )


def test_a_level_that_cannot_be_read_is_reported_and_the_rest_is_checked(tmp_path: Path) -> None:
    path = written(tmp_path, CORRIDOR, NO_BOX, UNKNOWN, STUCK)
    rows, said = document("check", path, code=2)
    fault = f"{path}: level 1, lines 6-8: no box; put a $ (or * on a goal) on the floor"
    unread = dict.fromkeys(("width", "height", "boxes", "solvable", "optimal_steps", "states"))
    assert rows[1] == {"index": 1, **unread, "error": fault}
    assert rows[2] == {"index": 2, **unread, "error": rows[2]["error"]}
    assert "line 11, column 3: unknown character 'X'" in rows[2]["error"]
    assert [row["solvable"] for row in rows] == [True, None, None, False]
    assert said == f"sfid: 2 of 4 levels ({path}:1, {path}:2) cannot be read; the first: {fault}\n"
    assert document("check", f"{path}:0") == (rows[:1], "")
    assert sfid("levels", "solve", f"{path}:1") == Done(2, "", f"sfid: {fault}\n")


def test_a_level_beyond_the_tables_is_solved_all_the_same(tmp_path: Path) -> None:
    (row,), said = document("solve", written(tmp_path, HALL))
    level = parse_levels(HALL)[0]
    board = level.start
    for action in from_lurd(row["lurd"]):
        board = step(board, action).board
    assert board.solved
    assert (row["solvable"], row["optimal_steps"], row["states"], said) == (
        True, len(row["lurd"]), 56 * 3_819_816, "",
    )  # fmt: skip


def test_a_level_beyond_every_limit_is_neither_solvable_nor_unsolvable(tmp_path: Path) -> None:
    (row,), said = document("check", written(tmp_path, VAST), code=1)
    assert (row["solvable"], row["optimal_steps"]) == (None, None)
    assert "positions, more than the limit of 500,000,000" in row["error"]
    assert said.endswith(
        "not known to be solvable: too many states to try them all; take away a box or some floor\n"
    )
    dead = VAST.replace("#@           #\n# $", "#$@          #\n#  ")
    (row,), said = document("solve", written(tmp_path, dead), code=1)
    assert (row["solvable"], row["lurd"]) == (False, None)
    assert "error" in row or "cannot be solved" in said


def test_a_fault_is_printed_beside_its_level_without_naming_the_file_again(tmp_path: Path) -> None:
    path = written(tmp_path, CORRIDOR, NO_BOX, VAST)
    lines = sfid("levels", "check", path).stdout.splitlines()
    assert [line.count(path) for line in lines] == [1, 1, 1]
    assert lines[1] == f"{path}:1 level 1, lines 6-8: no box; put a $ (or * on a goal) on the floor"
    assert lines[2].startswith(f"{path}:2 the level has 1,419,181,695,360 positions, more than")


@pytest.mark.parametrize("name", ["classroom", "two-boxes", "three-boxes"])
def test_a_printed_solution_solves_with_its_pushes_in_capitals(name: str) -> None:
    rows, _ = document("solve", name)
    for row, level in zip(rows, packaged(name), strict=True):
        actions = from_lurd(row["lurd"])
        board = level.start
        for action in actions:
            board = step(board, action).board
        assert board.solved
        assert (len(actions), to_lurd(level.start, actions)) == (row["optimal_steps"], row["lurd"])


def test_people_read_the_solution_and_the_count(tmp_path: Path) -> None:
    path = written(tmp_path, CORRIDOR)
    assert sfid("levels", "solve", path) == Done(
        0, f"{path}:0 6x3, 1 box, 2 steps, 16 states, 2 pushes\nRR\n", ""
    )
    assert sfid("levels", "check", path) == Done(0, f"{path}:0 6x3, 1 box, 2 steps, 16 states\n", "")
    assert sfid("levels", "list", path) == Done(0, f"{path}:0 6x3, 1 box, corridor\n", "")
    assert sfid("levels", "show", path) == Done(0, "; corridor\n######\n#@$ .#\n######\n", "")


def test_list_without_a_file_names_every_packaged_level_as_the_other_verbs_take_it() -> None:
    rows, _ = document("list")
    assert [row["level"] for row in rows] == [
        f"{name}:{index}"
        for name in ("classroom", "room", "three-boxes", "two-boxes")
        for index in range(len(packaged(name)))
    ]
    shown = [document("show", row["level"])[0][0]["xsb"] for row in rows[-2:]]
    assert shown == [level.to_xsb() for level in packaged("two-boxes")[-2:]]


def test_generated_levels_are_the_same_from_the_same_seed_and_read_back(tmp_path: Path) -> None:
    order = ("generate", "--boxes", "3", "--steps-min", "20", "--levels", "3", "--seed", "9")
    rows, _ = document(*order)
    path = str(tmp_path / "new.xsb")
    assert sfid("levels", *order, path) == Done(0, f"{path}: 3 levels\n", "")
    text = Path(path).read_text()
    assert sfid("levels", *order) == Done(0, text, "")
    levels = parse_levels(text)
    assert [(level.to_xsb(), level.title) for level in levels] == [(row["xsb"], row["title"]) for row in rows]
    checked, _ = document("check", path)
    assert checked == [{key: row[key] for key in checked[0]} for row in rows]
    assert all(row["solvable"] and row["optimal_steps"] >= 20 and row["boxes"] == 3 for row in checked)
    done = sfid("levels", *order, path)
    assert done == Done(2, "", f"sfid: {path} is there already: name a new file, or move this one away\n")


@pytest.mark.parametrize(
    "arguments, named",
    [
        (("check", "nowhere.xsb"), "no level 'nowhere.xsb'"),
        (("solve", "room:1"), "room has one level, counted from 0: name room:0"),
        (("show", "classroom:7"), "name one from classroom:0 to classroom:6"),
        (("check", "room:" + "9" * 5000), "is no level's number: they count from 0, as in room:0"),
        (("check", "room:-1"), "'room:-1': '-1' is no level's number: they count from 0, as in room:0"),
        (("generate", "--boxes", "9"), "boxes 9 is outside 1 to 8"),
        (("generate", "--levels", "0"), "levels 0 is outside 1 to 1000"),
        (("generate", "--size", "8"), "size '8' is no size: write columns x rows, as in 8x8"),
        (("generate", "--seed", "-1"), "seed -1 is outside"),
        (("generate", "--size", "4x4"), "enlarge it or take fewer boxes"),
        (
            ("generate", "--size", "5x5", "--boxes", "1", "--steps-min", "40"),
            "none in 2,000 rooms",
        ),
        (("generate", "no/such/folder/x.xsb"), "cannot write no/such/folder/x.xsb"),
    ],
)
def test_bad_input_is_exit_2_and_one_line(arguments: tuple[str, ...], named: str) -> None:
    done = sfid("levels", *arguments)
    assert (done.code, done.stdout, len(done.stderr.splitlines())) == (2, "", 1), done
    assert named in done.stderr


@pytest.mark.parametrize(
    "rows, starts, complaint",
    [
        (STUCK, "1", 'the level cannot be solved from its own start; move a box, or use starts "all"'),
        ("######\n# @* #\n######", "4", "the level is solved at its start; move a box off its goal"),
        (HALL, "all", 'the level has too many states to draw starts from; use starts "1"'),
        ("#####\n#@ $#\n#. ##\n#####", "all", "the level has no start that can be solved; check its walls"),
        (CORRIDOR, "99", "starts: 99 asked for, but the level has only 3 that can be solved"),
        (CORRIDOR, "within:0", "starts 'within:0' is unknown"),
    ],
)
def test_a_level_that_cannot_give_the_starts_is_refused_before_anything_starts(
    tmp_path: Path, rows: str, starts: str, complaint: str
) -> None:
    path, data = written(tmp_path, rows), tmp_path / "data"
    done = sfid("demo", "--no-viewer", "--data", str(data), "--level", path, "--starts", starts)
    assert (done.code, done.stdout, len(done.stderr.splitlines())) == (2, "", 1), done
    assert complaint in done.stderr
    assert not data.exists()


@pytest.mark.skipif(not BOXOBAN.exists(), reason="the Boxoban test levels are not on this machine")
@pytest.mark.parametrize("starts, optimal", [("1", {30}), ("all", range(1, 100)), ("within:3", range(1, 4))])
def test_a_boxoban_level_is_taught_from_any_distribution_of_starts(
    tmp_path: Path, starts: str, optimal: Container[int]
) -> None:
    data = str(tmp_path / "data")
    world = ("--level", f"{BOXOBAN}:3", "--starts", starts, "--episodes", "2", "--seed", "1")
    done = sfid("demo", "--no-viewer", "--data", data, *world, "--json")
    assert done.code == 0, done
    episodes = json.loads(done.stdout)["episodes"]
    assert [row["optimal_steps"] in optimal for row in episodes] == [True, True]


@pytest.mark.skipif(not BOXOBAN.exists(), reason="the Boxoban test levels are not on this machine")
def test_a_boxoban_file_is_checked_and_solved_by_number() -> None:
    rows, _ = document("solve", f"{BOXOBAN}:7")
    level = load_bytes(BOXOBAN.read_bytes(), BOXOBAN.name)[7]
    board = level.start
    for action in from_lurd(rows[0]["lurd"]):
        board = step(board, action).board
    assert board.solved
    checked, _ = document("check", f"{BOXOBAN}:7")
    assert checked == [{key: rows[0][key] for key in rows[0] if key != "lurd"}]
