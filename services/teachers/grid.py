"""A view in XSB text as rows of styled cells, two columns a cell so that cells look square."""

from enum import Enum

from rich.text import Text

from services.gym.rendering import PICTURE_PREFIX, is_board


class Cell(Enum):
    """What stands on a cell: XSB glyph, two columns to print, style.

    The print tells everything without colour. The colours are those of Okabe & Ito (2008), which stay apart
    in the common forms of colour blindness.
    """

    WALL = ("#", "██", "#6b6b6b")
    FLOOR = (" ", "  ", "")
    GOAL = (".", "()", "bold #56b4e9")
    BOX = ("$", "[]", "bold #000000 on #e69f00")
    BOX_ON_GOAL = ("*", "{}", "bold #000000 on #009e73")
    PLAYER = ("@", "@@", "bold #000000 on #f0e442")
    PLAYER_ON_GOAL = ("+", "(@", "bold #000000 on #f0e442")
    UNKNOWN = ("?", "??", "reverse")

    def __init__(self, glyph: str, shown: str, style: str) -> None:
        self.glyph = glyph
        self.shown = shown
        self.style = style


Rows = tuple[tuple[Cell, ...], ...]

LEGEND = "@@ agent   [] box   () goal   {} box on goal"

_BY_GLYPH = {cell.glyph: cell for cell in Cell} | {"-": Cell.FLOOR, "_": Cell.FLOOR}
_PLAYERS = (Cell.PLAYER, Cell.PLAYER_ON_GOAL)


def shown(view: str, width: int, height: int) -> Text:
    """Return any view for the terminal, at most `width` cells of two columns by `height` lines.

    A board is drawn cell by cell; another world's text stands as it is, and a picture is told of.
    """
    if is_board(view) or not view:
        return drawn(cropped(rows_of(view), width, height))
    if view.startswith(PICTURE_PREFIX):
        return Text("a picture: teach this session in a browser,\nor create it with --gym-render text")
    lines = [line[: max(1, 2 * width)] for line in view.split("\n")[: max(1, height)]]
    return Text("\n".join(lines), no_wrap=True)


def legend(view: str) -> str:
    """Return what the cells of a board mean; nothing for another world's view, which says it itself."""
    return LEGEND if is_board(view) or not view else ""


def rows_of(view: str) -> Rows:
    """Return the cells of a view, every row as long as the longest; a glyph that is not XSB's is UNKNOWN."""
    lines = view.split("\n") if view else []
    width = max(map(len, lines), default=0)
    return tuple(tuple(_BY_GLYPH.get(glyph, Cell.UNKNOWN) for glyph in line.ljust(width)) for line in lines)


def cropped(rows: Rows, width: int, height: int) -> Rows:
    """Return at most `width` x `height` cells, with the player as near to the middle as can be."""
    row, column = _player(rows)
    top = _first(row, height, len(rows))
    left = _first(column, width, len(rows[0]) if rows else 0)
    return tuple(line[left : left + max(1, width)] for line in rows[top : top + max(1, height)])


def drawn(rows: Rows) -> Text:
    """Return the rows for the terminal."""
    text = Text(no_wrap=True)
    for number, row in enumerate(rows):
        if number:
            text.append("\n")
        for cell in row:
            text.append(cell.shown, cell.style or None)
    return text


def _player(rows: Rows) -> tuple[int, int]:
    for number, row in enumerate(rows):
        for column, cell in enumerate(row):
            if cell in _PLAYERS:
                return number, column
    return 0, 0


def _first(middle: int, shown: int, total: int) -> int:
    """Return where a stretch of `shown` out of `total` begins so that `middle` is in it."""
    return max(0, min(middle - shown // 2, total - shown))
