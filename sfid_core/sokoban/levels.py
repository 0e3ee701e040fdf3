"""Levels out of text: XSB, run-length rows, Boxoban files and `.sok` collections.

Sources: sokobano.de wiki, "Level format"; Sokoban File Format 0.17; boxoban-levels README.
"""

from collections.abc import Iterable
from functools import cache
from importlib import resources

from sfid_core.sokoban.board import Level
from sfid_core.sokoban.notation import SIDE_MAX, Block, LevelError, Row, blocks_of, too_big

__all__ = [
    "FILE_BYTES_MAX",
    "LevelError",
    "collection",
    "load_bytes",
    "packaged",
    "packaged_levels",
    "parse_levels",
    "read_bytes",
    "read_levels",
]

FILE_BYTES_MAX = 256 * 1024
"""A file of levels: a thousand Boxoban levels are 120 KiB."""

_TEXT_CONTROLS = frozenset(b"\t\n\r\f\x1a")


def parse_levels(text: str) -> tuple[Level, ...]:
    """Read every level of a text, in order; ragged, indented and trimmed rows are normal.

    Raises LevelError, one line: what is wrong, where (level, line), and the mend.
    """
    return _all_sound(read_levels(text))


def read_levels(text: str) -> tuple[Level | LevelError, ...]:
    """Read every level of a text, in order, and in place of one that cannot be read its fault.

    Raises LevelError when there is no level at all.
    """
    blocks, shared = blocks_of(text)
    if not blocks:
        message = "no level found; draw one with # walls, @ player, $ boxes and . goals"
        raise LevelError(message)
    return tuple(_level_or_fault(block, shared) for block in blocks)


def load_bytes(data: bytes, source: str) -> tuple[Level, ...]:
    """Read the levels of a file's bytes; `source` names the file in errors.

    UTF-8 with or without a byte-order mark, any line ends, FILE_BYTES_MAX at most.  Raises LevelError.
    """
    return _all_sound(read_bytes(data, source))


def read_bytes(data: bytes, source: str) -> tuple[Level | LevelError, ...]:
    """Read a file's bytes as `load_bytes` does, with its fault in place of a level that cannot be read.

    Raises LevelError when the file is no text or has no level.
    """
    if len(data) > FILE_BYTES_MAX:
        message = (
            f"{source}: too big, {len(data)} bytes; a file of levels has at most {FILE_BYTES_MAX}: split it"
        )
        raise LevelError(message)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"{source}: not UTF-8 text at byte {error.start}; save the levels as plain UTF-8 text"
        raise LevelError(message) from None
    control = next((byte for byte in data if byte < ord(" ") and byte not in _TEXT_CONTROLS), None)
    if control is not None:
        message = f"{source}: binary, not text (byte 0x{control:02x}); save the levels as plain UTF-8 text"
        raise LevelError(message)
    try:
        read = read_levels(text)
    except LevelError as error:
        message = f"{source}: {error}"
        raise LevelError(message) from None
    return tuple(LevelError(f"{source}: {one}") if isinstance(one, LevelError) else one for one in read)


def collection(levels: Iterable[Level]) -> str:
    """Return levels as the text of one file, with their titles and authors, that reads back to them."""
    return "\n".join(_with_keys(level) for level in levels)


def packaged_levels() -> tuple[str, ...]:
    """Return the names of the level sets that come with the package, in alphabetical order."""
    folder = resources.files("sfid_core.sokoban").joinpath("levels")
    names = (entry.name for entry in folder.iterdir())
    return tuple(sorted(name.removesuffix(".xsb") for name in names if name.endswith(".xsb")))


@cache
def packaged(name: str) -> tuple[Level, ...]:
    """Return the levels of a packaged set by its name; LevelError names the sets there are."""
    if name not in packaged_levels():
        message = f"no packaged level set {name!r}; there are: {', '.join(packaged_levels())}"
        raise LevelError(message)
    file = resources.files("sfid_core.sokoban").joinpath("levels", f"{name}.xsb")
    return load_bytes(file.read_bytes(), f"{name}.xsb")


def _with_keys(level: Level) -> str:
    keys = (("Title", level.title), ("Author", level.author))
    return "".join(f"{line}\n" for line in (level.to_xsb(), *(f"{k}: {text}" for k, text in keys if text)))


def _all_sound(read: tuple[Level | LevelError, ...]) -> tuple[Level, ...]:
    """Return the levels; raise the first fault among them."""
    levels = []
    for one in read:
        if isinstance(one, LevelError):
            raise one
        levels.append(one)
    return tuple(levels)


def _level_or_fault(block: Block, shared: dict[str, str]) -> Level | LevelError:
    if block.fault is not None:
        return block.fault
    try:
        return _level(block, shared)
    except LevelError as fault:
        return fault


def _level(block: Block, shared: dict[str, str]) -> Level:
    rows = _cropped(block)
    _check_counts(block.number, rows)
    height, width = len(rows), max(len(row.text) for row in rows)
    cells = "".join(row.text.ljust(width) for row in rows)
    level = Level(
        width=width,
        height=height,
        walls=frozenset(_where(cells, "#")),
        goals=_where(cells, ".+*"),
        player=_where(cells, "@+")[0],
        boxes=_where(cells, "$*"),
        title=block.keys.get("title", ""),
        author=block.keys.get("author", shared.get("author", "")),
    )
    _check_enclosed(block.number, rows, level)
    return level


def _where(cells: str, glyphs: str) -> tuple[int, ...]:
    return tuple(cell for cell, glyph in enumerate(cells) if glyph in glyphs)


def _cropped(block: Block) -> list[Row]:
    """Drop the empty rows and columns around a level, so that indenting one does not change it."""
    drawn = [index for index, row in enumerate(block.rows) if row.text]
    rows = block.rows[drawn[0] : drawn[-1] + 1] if drawn else []
    if len(rows) > SIDE_MAX:
        raise too_big(block.number, _lines_of(rows), "rows", len(rows))
    indent = min((len(row.text) - len(row.text.lstrip(" ")) for row in rows if row.text), default=0)
    return [Row(row.line, row.text[indent:]) for row in rows]


def _check_counts(number: int, rows: list[Row]) -> None:
    where = f"level {number}, {_lines_of(rows)}"
    drawn = "".join(row.text for row in rows)
    players = [row.line for row in rows for glyph in row.text if glyph in "@+"]
    boxes, goals = sum(map(drawn.count, "$*")), sum(map(drawn.count, ".+*"))
    if not players:
        message = f"{where}: no player; put one @ (or + on a goal) on the floor"
    elif len(players) > 1:
        lines = " and ".join(str(line) for line in players[:2])
        message = f"{where}: {_counted(len(players), 'player')} (lines {lines}); keep one @ or +"
    elif not boxes:
        message = f"{where}: no box; put a $ (or * on a goal) on the floor"
    elif boxes != goals:
        missing = _counted(abs(boxes - goals), "goal" if goals < boxes else "box")
        message = (
            f"{where}: {_counted(boxes, 'box')} and {_counted(goals, 'goal')}; "
            f"every box needs a goal of its own: {missing} missing"
        )
    else:
        return
    raise LevelError(message)


def _check_enclosed(number: int, rows: list[Row], level: Level) -> None:
    for cell in level.reach:
        row, column = divmod(cell, level.width)
        if row in {0, level.height - 1} or column in {0, level.width - 1}:
            message = (
                f"level {number}, line {rows[row].line}: not enclosed, the player can walk out at "
                f"row {row + 1}, column {column + 1} of the level; close the wall there with #"
            )
            raise LevelError(message)


def _lines_of(rows: list[Row]) -> str:
    if not rows:
        return "no line"
    first, last = rows[0].line, rows[-1].line
    return f"line {first}" if first == last else f"lines {first}-{last}"


_WORDS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five"}


def _counted(count: int, thing: str) -> str:
    return f"{_WORDS.get(count, count)} {thing if count == 1 else _plural(thing)}"


def _plural(thing: str) -> str:
    return thing + ("es" if thing.endswith("x") else "s")
