"""The pictures of doubt: where on the floor teachers disagree, and the states to look at again."""

import numpy as np

from services import tiles
from services.monitor.doubts import Doubtful, Doubts
from services.monitor.png import encode_palette_png
from services.monitor.rows import Arrow, Document, Moment, Picture
from services.monitor.scene import ViewError, read_view
from services.monitor.status import SIGNS
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.board import Board

CONFLICTS = "conflicts"
STATES = "doubtful"
LIST = "doubts"
COLUMNS = 3
GUTTER = tiles.TILE
ARROW_COLOUR = (255, 200, 60)


def draw_conflicts(board: Board, doubts: Doubts, moment: Moment) -> Picture:
    """Return the floor: dark where labels agreed, brightest where teachers differed most often."""
    indexes = tiles.background(board.level)
    indexes += np.uint8(tiles.DIMMED)
    shares = {cell: splits / visits for cell, (visits, splits) in doubts.cells().items()}
    most = max(shares.values(), default=0.0) or 1.0
    for cell, share in shares.items():
        if cell in board.level.reach:
            colour = tiles.VALUES + round(share / most * (tiles.VALUE_COLOURS - 1))
            tiles.cell_view(indexes, board.level, cell)[1:-1, 1:-1] = colour
    return Picture(CONFLICTS, moment, encode_palette_png(indexes, tiles.palette()))


def draw_doubtful(states: list[Doubtful], moment: Moment) -> Picture | None:
    """Return the states side by side, worst first, each with what was said there; None without any."""
    boards = [(read_view(state.view), state) for state in states]
    if not boards:
        return None
    high = max(board.level.height for board, _ in boards) * tiles.TILE
    wide = max(board.level.width for board, _ in boards) * tiles.TILE
    columns, rows = min(COLUMNS, len(boards)), -(-len(boards) // COLUMNS)
    canvas = np.zeros((rows * (high + GUTTER), columns * (wide + GUTTER)), np.uint8)
    arrows: list[Arrow] = []
    for number, (board, state) in enumerate(boards):
        top, left = (number // columns) * (high + GUTTER), (number % columns) * (wide + GUTTER)
        indexes = tiles.background(board.level)
        tiles.draw_boxes(indexes, board)
        tiles.put(indexes, board.level, board.player, tiles.KEEPER["DOWN"])
        canvas[top : top + indexes.shape[0], left : left + indexes.shape[1]] = indexes
        arrows += _arrows(board, state, (left, top))
    return Picture(STATES, moment, encode_palette_png(canvas, tiles.palette()), tuple(arrows))


def _arrows(board: Board, state: Doubtful, origin: tuple[int, int]) -> list[Arrow]:
    """An arrow for each action that was named, with how often: the wider, the more often."""
    row, column = divmod(board.player, board.level.width)
    x, y = origin[0] + (column + 0.5) * tiles.TILE, origin[1] + (row + 0.5) * tiles.TILE
    arrows = []
    most = max(teachers.total() for teachers in state.named.values())
    for action, teachers in sorted(state.named.items()):
        if action not in Action.__members__:
            continue
        down, right = Action[action].delta
        start = (x + right * tiles.TILE / 2, y + down * tiles.TILE / 2)
        vector = (right * 0.75 * tiles.TILE, down * 0.75 * tiles.TILE)
        share = teachers.total() / most
        arrow = Arrow(
            start, vector, ARROW_COLOUR, str(teachers.total()), 1.6 + 2.4 * share, 0.4 + 0.6 * share
        )
        arrows.append(arrow)
    return arrows


def tell_doubtful(states: list[Doubtful], moment: Moment) -> Document:
    """Return the same states in words."""
    if not states:
        return Document(LIST, moment, "### No doubtful state so far\n\nWhat teachers said fits together.")
    lines = [f"{number}. {state.reasons()} · {_named(state)}" for number, state in enumerate(states, start=1)]
    return Document(LIST, moment, "### Look at these states again\n\n" + "\n".join(lines))


def _named(state: Doubtful) -> str:
    """Return who named which action how often."""
    return " · ".join(
        f"**{SIGNS.get(action, action)}** "
        + ", ".join(f"{name} {count}" for name, count in teachers.most_common(3))
        for action, teachers in sorted(state.named.items(), key=lambda item: -item[1].total())
    )


def drawn(doubts: Doubts, view: str, moment: Moment) -> tuple[list[Picture], list[Document]]:
    """Return pictures and words about what is doubtful now; nothing where a view cannot be drawn."""
    states = doubts.worst()
    try:
        gallery = draw_doubtful(states, moment)
        pictures = [draw_conflicts(read_view(view), doubts, moment)]
    except ViewError:
        return [], []
    return pictures + ([] if gallery is None else [gallery]), [tell_doubtful(states, moment)]
