from services.teachers.grid import Cell, cropped, drawn, rows_of

VIEW = "#####\n#.$*#\n#@+ #\n###"


def test_a_view_is_drawn_with_two_columns_a_cell_and_every_thing_looks_different() -> None:
    assert drawn(rows_of(VIEW)).plain == "██████████\n██()[]{}██\n██@@(@  ██\n██████    "
    assert len({cell.shown for cell in Cell}) == len(Cell)
    assert {len(cell.shown) for cell in Cell} == {2}


def test_floor_may_be_drawn_as_a_dash_or_an_underscore_and_a_foreign_glyph_is_shown_as_one() -> None:
    assert rows_of("-_ x") == ((Cell.FLOOR, Cell.FLOOR, Cell.FLOOR, Cell.UNKNOWN),)


def test_no_view_is_no_rows() -> None:
    assert (rows_of(""), cropped(rows_of(""), 10, 10), drawn(()).plain) == ((), (), "")


def test_a_level_that_does_not_fit_is_cropped_around_the_player() -> None:
    rows = rows_of("\n".join(["#" * 30, "#" + " " * 22 + "@" + " " * 5 + "#", *["#" + " " * 28 + "#"] * 20]))
    part = cropped(rows, 9, 5)
    assert (len(part), {len(row) for row in part}) == (5, {9})
    assert part[1].index(Cell.PLAYER) == 4
    corner = cropped(rows_of("@" + "#" * 20), 4, 3)
    assert corner == ((Cell.PLAYER, Cell.WALL, Cell.WALL, Cell.WALL),)


def test_a_level_that_fits_is_shown_whole() -> None:
    rows = rows_of(VIEW)
    assert cropped(rows, 5, 4) == rows
