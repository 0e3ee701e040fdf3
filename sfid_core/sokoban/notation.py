"""The text of level files: XSB rows, run-length rows, comments and keys, cut into blocks."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby

SIDE_MAX = 128
"""Rows and columns of one level: 128 x 128 is far beyond published levels, and small enough to draw."""

_FLOOR = " -_"
_THINGS = "#@+$*."
_RUNS = "0123456789|"
_GLYPHS = frozenset(_FLOOR + _THINGS + _RUNS)
_LINE_END = re.compile(r"\r\n|\r|\n")
_KEY = re.compile(r"\s*([A-Za-z][A-Za-z /_-]{0,39})\s*:\s*(.*)")
_RUN = re.compile(r"(\d*)(\D)")


class LevelError(ValueError):
    """One line for the person who brought a level: what is wrong, where, and the mend."""


@dataclass(frozen=True)
class Row:
    """One row of a board as drawn, with the number of the line it came from (1 is the first)."""

    line: int
    text: str


@dataclass
class Block:
    """The rows of one level, or the fault for which they cannot be read, and its keys (`title`, ...)."""

    number: int
    """Its place in the file, from 0 as in FILE:N."""
    rows: list[Row]
    keys: dict[str, str] = field(default_factory=dict)
    fault: LevelError | None = None


@dataclass(frozen=True)
class _Line:
    number: int
    text: str
    kind: str  # "blank", "comment", "key", "row" or "text"


def blocks_of(text: str) -> tuple[list[Block], dict[str, str]]:
    """Cut a file into its levels, and the keys that stand for the whole file.

    Keys belong to the level they follow, as in `.sok` files; a run of keys that touches the next
    level and not the one before belongs to the next.  A row that holds an unknown character or is too
    long is the fault of its block.
    """
    runs = [(kind, list(lines)) for kind, lines in groupby(_lines(text), _run_kind)]
    shared: dict[str, str] = {}
    blocks: list[Block] = []
    pending: dict[str, str] = {}
    for index, (kind, lines) in enumerate(runs):
        if kind == "rows":
            blocks.append(_block(len(blocks), lines, pending))
            pending = {}
        elif kind == "words":
            keys = dict(_keys(lines))
            touches_next = index + 1 < len(runs) and runs[index + 1][0] == "rows"
            touches_last = index > 0 and runs[index - 1][0] == "rows"
            if touches_next and not touches_last:
                pending = keys
            else:
                (blocks[-1].keys if blocks else shared).update(keys)
    return blocks, shared


def _block(number: int, lines: list[_Line], keys: dict[str, str]) -> Block:
    try:
        return Block(number, [row for line in lines for row in _rows(line, number)], keys)
    except LevelError as fault:
        return Block(number, [], keys, fault)


def _lines(text: str) -> Iterator[_Line]:
    inside = False
    for number, line in enumerate(_LINE_END.split(text), start=1):
        kind = _kind(line, inside=inside)
        inside = kind == "row"
        yield _Line(number, line, kind)


def _run_kind(line: _Line) -> str:
    return {"blank": "blank", "row": "rows"}.get(line.kind, "words")


def _kind(line: str, *, inside: bool) -> str:
    """Tell what a line is; `inside` says that the line above was a row of a board."""
    bare = line.strip(" ")
    if not bare:
        return "blank"
    if bare.startswith((";", "::")):
        return "comment"
    if _GLYPHS.issuperset(bare):
        return "row" if inside or not set(bare).isdisjoint(_THINGS) else "text"
    if _KEY.fullmatch(line):
        return "key"
    # A line with a wall in it, or one that touches a board from below, was meant as a row.
    return "row" if inside or "#" in bare else "text"


def _keys(lines: list[_Line]) -> Iterator[tuple[str, str]]:
    for line in lines:
        found = _KEY.fullmatch(line.text.lstrip(";: "))
        if found:
            yield found[1].strip().lower(), found[2].strip()


def _rows(line: _Line, level: int) -> Iterator[Row]:
    """Yield the rows one line draws, runs written out; a line without runs is one row."""
    for column, glyph in enumerate(line.text, start=1):
        if glyph not in _GLYPHS:
            message = (
                f"level {level}, line {line.number}, column {column}: unknown character {glyph!r}; "
                f"a board is drawn with {_THINGS} and space, - or _"
            )
            raise LevelError(message)
    if line.text[-1].isdigit():
        message = (
            f"level {level}, line {line.number}: the count at the end of {line.text[-8:]!r} has nothing to "
            "repeat; write the character after its count, as in 3#"
        )
        raise LevelError(message)
    for part in _written_out(line, level).split("|"):
        if len(part.rstrip(_FLOOR)) > SIDE_MAX:
            raise too_big(level, f"line {line.number}", "columns", len(part))
        yield Row(line.number, part.replace("-", " ").replace("_", " ").rstrip(" "))


def _written_out(line: _Line, level: int) -> str:
    parts = []
    for count, glyph in _RUN.findall(line.text):
        # The length is looked at before the number is made: 99...9# must not fill the memory.
        if len(count.lstrip("0")) > len(str(SIDE_MAX)) or int(count or 1) > SIDE_MAX:
            raise too_big(level, f"line {line.number}", "columns or rows", int(count[:18]))
        parts.append(glyph * int(count or 1))
    return "".join(parts)


def too_big(level: int, where: str, what: str, size: int) -> LevelError:
    """Return the error of a level larger than SIDE_MAX."""
    return LevelError(
        f"level {level}, {where}: too big, {size} {what}; "
        f"a level has at most {SIDE_MAX} rows and {SIDE_MAX} columns"
    )
