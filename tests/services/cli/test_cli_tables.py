"""Tables in a pipe or a narrow terminal: wider than the place rather than short of data."""

from io import StringIO

from rich.console import Console
from rich.table import Table

from services.cli.shared.tables import print_whole

CELLS = ("a-long-name-that-nothing-cuts", "1234567890", "some words that may be wrapped where they must")


def printed(width: int) -> list[str]:
    table = Table(box=None, pad_edge=False)
    table.add_column("name", no_wrap=True)
    table.add_column("number of things", no_wrap=True)
    table.add_column("what")
    table.add_row(*CELLS)
    console = Console(file=StringIO(), width=width)
    print_whole(table, console)
    assert console.width == width
    stream = console.file
    assert isinstance(stream, StringIO)
    return stream.getvalue().splitlines()


def test_a_table_that_does_not_fit_is_printed_wider_and_whole() -> None:
    lines = printed(30)
    text = "\n".join(lines)
    assert "…" not in text
    assert {CELLS[0], CELLS[1], "number of things"} <= {
        part.strip() for part in text.replace("  ", "\n").split("\n")
    }
    assert " ".join(line[-7:].strip() for line in lines[1:]) == CELLS[2]


def test_a_table_that_fits_is_as_wide_as_the_terminal_lets_it() -> None:
    lines = printed(120)
    assert len(lines) == 2
    assert all(cell in lines[1] for cell in CELLS)
