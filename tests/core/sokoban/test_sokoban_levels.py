"""Level files: every form that is read, and every fault by its name."""

from itertools import groupby
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfid_core.sokoban.board import Level
from sfid_core.sokoban.levels import (
    FILE_BYTES_MAX,
    LevelError,
    load_bytes,
    packaged,
    packaged_levels,
    parse_levels,
    read_bytes,
)
from sfid_core.sokoban.solver import solve
from sfid_core.sokoban.tables import count_states

BOXOBAN = Path(__file__).resolve().parents[4] / "shared" / "data" / "boxoban-test-100.txt"

ONE = "#####\n#@$.#\n#####"


@st.composite
def levels(draw: st.DrawFn) -> Level:
    """Draw a walled level with rooms, inner walls, and boxes and goals anywhere on its floor."""
    width, height = draw(st.integers(3, 9)), draw(st.integers(3, 7))
    inside = [row * width + column for row in range(1, height - 1) for column in range(1, width - 1)]
    if len(inside) < 2:
        width, height, inside = 4, 3, [5, 6]
    order = draw(st.permutations(inside))
    count = draw(st.integers(1, min(4, len(inside) - 1)))
    player, boxes, rest = order[0], order[1 : count + 1], order[count + 1 :]
    walls = {cell for cell in range(width * height) if cell not in inside}
    walls |= set(draw(st.sets(st.sampled_from(rest), max_size=len(rest) - 1))) if rest else set()
    free = [cell for cell in order if cell not in walls]
    goals = draw(st.permutations(free))[:count]
    return Level(width, height, frozenset(walls), tuple(goals), player, tuple(boxes))


def run_length(text: str) -> str:
    rows = text.replace(" ", "-").split("\n")
    return "|".join(
        "".join(
            f"{len(run)}{glyph}" if len(run) > 1 else glyph
            for glyph, run in ((glyph, list(run)) for glyph, run in groupby(row))
        )
        for row in rows
    )


@given(levels())
def test_xsb_text_reads_back_as_the_same_level(level: Level) -> None:
    assert parse_levels(level.to_xsb()) == (level,)


@given(levels())
def test_run_length_rows_read_back_as_the_same_level(level: Level) -> None:
    assert parse_levels(run_length(level.to_xsb())) == (level,)


@given(levels(), st.sampled_from("-_ "), st.sampled_from(["\n", "\r\n", "\r"]), st.integers(0, 5))
def test_floor_glyph_line_end_and_indent_do_not_change_a_level(
    level: Level, floor: str, line_end: str, indent: int
) -> None:
    rows = [" " * indent + row.replace(" ", floor) for row in level.to_xsb().split("\n")]
    text = "\ufeff" + line_end.join(rows) + line_end
    assert load_bytes(text.encode(), "x.xsb") == (level,)


@given(st.binary(max_size=200) | st.text("#@$.*+ -_|0123456789;:\n\r\tT", max_size=120).map(str.encode))
def test_any_bytes_give_levels_or_one_line_of_complaint(data: bytes) -> None:
    complaint = ""
    read: tuple[Level, ...] = ()
    try:
        read = load_bytes(data, "x.xsb")
    except LevelError as error:
        complaint = str(error)
    assert bool(read) != complaint.startswith("x.xsb: ")
    assert "\n" not in complaint
    assert all(len(level.boxes) == len(level.goals) > 0 for level in read)


def test_ragged_and_trimmed_rows_are_filled_with_floor() -> None:
    ragged = "   ####\n####  #####\n#  $ @  . #   \n####  #####\n   #  #\n   ####"
    (level,) = parse_levels(ragged)
    assert level.to_xsb().split("\n") == [
        "   ####    ",
        "####  #####",
        "#  $ @  . #",
        "####  #####",
        "   #  #    ",
        "   ####    ",
    ]


def test_boxes_out_of_reach_are_legal_when_the_player_is_walled_in() -> None:
    (level,) = parse_levels("########\n#@$.#* #\n########")
    assert (level.boxes, level.goals, level.reach) == ((10, 13), (11, 13), (9, 10, 11))


def test_comments_separate_levels_and_keys_name_them() -> None:
    text = (
        ":: a collection\nCollection: Mine\nAuthor: everybody\n\n"
        f"{ONE}\nTitle: first\nAuthor: one person\n\n{ONE}\nTitle: second\n\n"
        f"; 3\n{ONE}\n\nTitle: fourth\n{ONE}\n"
    )
    assert [(level.title, level.author) for level in parse_levels(text)] == [
        ("first", "one person"),
        ("second", "everybody"),
        ("", "everybody"),
        ("fourth", "everybody"),
    ]


@pytest.mark.parametrize(
    "text, complaint",
    [
        ("", "no level found; draw one with # walls, @ player, $ boxes and . goals"),
        (
            "just words\n\nand more",
            "no level found; draw one with # walls, @ player, $ boxes and . goals",
        ),
        ("#####\n# $.#\n#####", "level 0, lines 1-3: no player; put one @ (or + on a goal) on the floor"),
        ("######\n#@$.@#\n######", "level 0, lines 1-3: two players (lines 2 and 2); keep one @ or +"),
        ("####\n#@.#\n####", "level 0, lines 1-3: no box; put a $ (or * on a goal) on the floor"),
        (
            "######\n#@$$.#\n######",
            "level 0, lines 1-3: two boxes and one goal; every box needs a goal of its own: one goal missing",
        ),
        (
            "########\n#@$...*#\n########",
            (
                "level 0, lines 1-3: two boxes and four goals; "
                "every box needs a goal of its own: two boxes missing"
            ),
        ),
        (
            f"{ONE}\n\n#####\n#@$.\n#####",
            (
                "level 1, line 6: not enclosed, the player can walk out at row 2, column 5 of the level; "
                "close the wall there with #"
            ),
        ),
        (
            "#####\n#@X.#\n#####",
            (
                "level 0, line 2, column 3: unknown character 'X'; "
                "a board is drawn with #@+$*. and space, - or _"
            ),
        ),
        (
            f"{ONE}\n\n#####\n#@\t.#\n#####",
            (
                "level 1, line 6, column 3: unknown character '\\t'; "
                "a board is drawn with #@+$*. and space, - or _"
            ),
        ),
        (
            "#" * 129,
            "level 0, line 1: too big, 129 columns; a level has at most 128 rows and 128 columns",
        ),
        (
            "\n".join(["#"] * 129),
            "level 0, lines 1-129: too big, 129 rows; a level has at most 128 rows and 128 columns",
        ),
        (
            "9999999999#",
            (
                "level 0, line 1: too big, 9999999999 columns or rows; "
                "a level has at most 128 rows and 128 columns"
            ),
        ),
        (
            "#####|#@$.#|#####3",
            (
                "level 0, line 1: the count at the end of '#|#####3' has nothing to repeat; "
                "write the character after its count, as in 3#"
            ),
        ),
    ],
)
def test_a_malformed_level_is_refused_with_its_fault_place_and_mend(text: str, complaint: str) -> None:
    with pytest.raises(LevelError) as caught:
        parse_levels(text)
    assert str(caught.value) == complaint


@pytest.mark.parametrize(
    "data, complaint",
    [
        (
            b"#" * (1 << 20),
            f"big.xsb: too big, 1048576 bytes; a file of levels has at most {FILE_BYTES_MAX}: split it",
        ),
        (b"\x89PNG\r\n", "big.xsb: not UTF-8 text at byte 0; save the levels as plain UTF-8 text"),
        (b"\x7fELF\x00\x01", "big.xsb: binary, not text (byte 0x00); save the levels as plain UTF-8 text"),
        (
            "#####".encode("utf-16"),
            "big.xsb: not UTF-8 text at byte 0; save the levels as plain UTF-8 text",
        ),
        (b"", "big.xsb: no level found; draw one with # walls, @ player, $ boxes and . goals"),
    ],
)
def test_a_file_that_is_no_level_text_is_refused_by_name(data: bytes, complaint: str) -> None:
    with pytest.raises(LevelError) as caught:
        load_bytes(data, "big.xsb")
    assert str(caught.value) == complaint


@pytest.mark.parametrize(
    "fields, complaint",
    [
        ({"player": 99}, "a cell of the level lies outside its 5 x 3 grid"),
        ({"player": 0}, "a goal, box or player of the level stands in a wall"),
        ({"player": 7}, "two boxes, or a box and the player, share a cell of the level"),
    ],
)
def test_a_level_built_by_hand_must_hold_together(fields: dict[str, int], complaint: str) -> None:
    (level,) = parse_levels(ONE)
    with pytest.raises(ValueError, match=complaint):
        Level(5, 3, level.walls, level.goals, fields["player"], level.boxes)


def test_the_packaged_room_is_the_room_of_the_paper_from_its_hardest_start() -> None:
    (room,) = packaged("room")
    solution = solve(room)
    assert (room.title, room.author, room.width, room.height) == ("room", "SfID authors", 7, 7)
    assert (solution.distance(room.start), solution.longest) == (11, 11)


def test_the_packaged_lessons_can_be_solved_and_grow_harder() -> None:
    assert packaged_levels() == ("classroom", "room", "three-boxes", "two-boxes")
    lessons = packaged("classroom")
    steps = [solve(level).distance(level.start) for level in lessons]
    assert steps == [2, 6, 9, 12, 17, 24, 35]
    assert [len(level.boxes) for level in lessons] == [1, 1, 1, 2, 2, 2, 3]
    assert len({level.title for level in lessons}) == 7
    assert {level.author for level in lessons} == {"SfID authors"}


@pytest.mark.parametrize(
    "name, boxes, steps, states_max",
    [("two-boxes", 2, [12, 20, 28, 39], 30_000), ("three-boxes", 3, [21, 32, 41], 300_000)],
)
def test_the_packaged_rooms_for_experiments_are_of_modest_size_and_grow_harder(
    name: str, boxes: int, steps: list[int], states_max: int
) -> None:
    rooms = packaged(name)
    assert [solve(room).distance(room.start) for room in rooms] == steps
    assert {len(room.boxes) for room in rooms} == {boxes}
    assert max(map(count_states, rooms)) <= states_max
    assert len({room.title for room in rooms}) == len(rooms)
    assert {room.author for room in rooms} == {"SfID authors"}


def test_a_level_that_cannot_be_read_leaves_the_others_readable() -> None:
    text = f"{ONE}\n\n####\n#@.#\n####\n\n#####\n#@X.#\n#####\nTitle: bad\n\n{ONE}\nTitle: good\n"
    first, no_box, unknown, last = read_bytes(text.encode(), "x.xsb")
    assert (first, last) == parse_levels(f"{ONE}\n\n{ONE}\nTitle: good")
    assert [str(no_box), str(unknown)] == [
        "x.xsb: level 1, lines 5-7: no box; put a $ (or * on a goal) on the floor",
        (
            "x.xsb: level 2, line 10, column 3: unknown character 'X'; "
            "a board is drawn with #@+$*. and space, - or _"
        ),
    ]
    with pytest.raises(LevelError, match="level 1, lines 5-7: no box"):
        load_bytes(text.encode(), "x.xsb")


def test_an_unknown_packaged_set_is_answered_with_those_there_are() -> None:
    with pytest.raises(
        LevelError,
        match=r"^no packaged level set 'nine'; there are: classroom, room, three-boxes, two-boxes$",
    ):
        packaged("nine")


@pytest.mark.skipif(not BOXOBAN.exists(), reason="the Boxoban test levels are not on this machine")
def test_a_boxoban_file_is_read_whole() -> None:
    read = load_bytes(BOXOBAN.read_bytes(), BOXOBAN.name)
    assert len(read) == 100
    assert {(level.width, level.height, len(level.boxes)) for level in read} == {(10, 10, 4)}
    first = read[0]
    assert first.to_xsb() == BOXOBAN.read_text().split("\n\n")[0].removeprefix("; 0\n")
