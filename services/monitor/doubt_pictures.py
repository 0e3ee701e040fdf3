"""The pictures of doubt: where on the floor teachers disagree, and the states to look at again."""

import numpy as np

from services import tiles
from services.monitor import font
from services.monitor.doubts import Doubtful, Doubts
from services.monitor.rows import Arrow, Document, Indexed, Moment, Picture
from services.monitor.sampling import Pace
from services.monitor.scene import ViewError, read_view
from services.monitor.status import SIGNS
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.board import Board

CONFLICTS = "conflicts"
STATES = "doubtful"
LIST = "doubts"
COLUMNS = 3
GAP = tiles.TILE
CAPTION = 2 * font.HEIGHT + 6
"""Pixels below a board that say its number, and how often which move was named."""
ARROW_COLOUR = (255, 200, 60)
AGAIN_MS = 30_000
"""Pictures that stay the same are written again: the viewers' server forgets them after a minute or two, and
somebody who comes later is to see them."""
_PALETTE = np.concatenate([tiles.palette(), np.array([ARROW_COLOUR], np.uint8)])
_WRITTEN = len(_PALETTE) - 1


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
    return Picture(CONFLICTS, moment, Indexed(indexes, tiles.palette()))


def draw_doubtful(states: list[Doubtful], moment: Moment) -> Picture | None:
    """Return the states side by side, worst first, numbered, with the moves named there; None without any."""
    boards = [(read_view(state.view), _moves(state)) for state in states]
    if not boards:
        return None
    captions = [_caption(number, moves) for number, (_, moves) in enumerate(boards, start=1)]
    high = max(board.level.height for board, _ in boards) * tiles.TILE + CAPTION
    wide = max(board.level.width * tiles.TILE for board, _ in boards)
    wide = max(wide, *(2 * font.width_of(caption) for caption in captions))
    columns, rows = min(COLUMNS, len(boards)), -(-len(boards) // COLUMNS)
    canvas = np.zeros((rows * (high + GAP), columns * (wide + GAP)), np.uint8)
    arrows: list[Arrow] = []
    for number, ((board, moves), caption) in enumerate(zip(boards, captions, strict=True)):
        top, left = (number // columns) * (high + GAP), (number % columns) * (wide + GAP)
        indexes = tiles.background(board.level)
        tiles.draw_boxes(indexes, board)
        tiles.put(indexes, board.level, board.player, tiles.KEEPER["DOWN"])
        below, right = top + indexes.shape[0], left + indexes.shape[1]
        canvas[top:below, left:right] = indexes
        font.write(canvas, caption, (below + 4, left), _WRITTEN)
        arrows += _arrows(board, moves, (left, top))
    return Picture(STATES, moment, Indexed(canvas, _PALETTE), tuple(arrows))


def _moves(state: Doubtful) -> dict[Action, int]:
    """How often each action was named."""
    named = {Action[name]: teachers.total() for name, teachers in state.named.items() if name in SIGNS}
    return dict(sorted(named.items()))


def _caption(number: int, moves: dict[Action, int]) -> str:
    return f"{number}: " + " ".join(f"{SIGNS[action.name]}{count}" for action, count in moves.items())


def _arrows(board: Board, moves: dict[Action, int], origin: tuple[int, int]) -> list[Arrow]:
    """An arrow for each action that was named: the wider, the more often."""
    row, column = divmod(board.player, board.level.width)
    x, y = origin[0] + (column + 0.5) * tiles.TILE, origin[1] + (row + 0.5) * tiles.TILE
    arrows = []
    for action, count in moves.items():
        down, right = action.delta
        start = (x + right * tiles.TILE / 2, y + down * tiles.TILE / 2)
        vector = (right * 0.75 * tiles.TILE, down * 0.75 * tiles.TILE)
        share = count / max(moves.values())
        arrows.append(Arrow(start, vector, ARROW_COLOUR, width=1.6 + 2.4 * share, opacity=0.4 + 0.6 * share))
    return arrows


def tell_doubtful(states: list[Doubtful], moment: Moment) -> Document:
    """Return the same states in words."""
    if not states:
        return Document(LIST, moment, "### No doubtful state so far\n\nWhat teachers said fits together.")
    lines = [f"{number}. {state.reasons()} · {_named(state)}" for number, state in enumerate(states, start=1)]
    return Document(LIST, moment, "\n".join(lines))


def _named(state: Doubtful) -> str:
    """Return who named which action how often."""
    return " · ".join(
        f"**{SIGNS.get(action, action)}** "
        + ", ".join(f"{name} {count}" for name, count in teachers.most_common(3))
        for action, teachers in sorted(state.named.items(), key=lambda item: -item[1].total())
    )


class DoubtRows:
    """What is doubtful, in pictures and words: those that differ from what was handed out before."""

    __slots__ = ("_again", "_last")

    def __init__(self) -> None:
        self._last: dict[str, Picture | Document] = {}
        self._again = Pace(AGAIN_MS)

    def changed(self, doubts: Doubts, view: str, moment: Moment, at_ns: int) -> list[Picture | Document]:
        """Return what has changed since the last call; nothing where a view cannot be drawn.

        Args: at_ns: the session's own time; every AGAIN_MS of it all is returned.
        """
        try:
            rows = _drawn(doubts, view, moment)
        except ViewError:
            return []
        if self._again.due(at_ns):
            self._last.clear()
        new = [row for row in rows if not _same(row, self._last.get(row.entity))]
        self._last.update({row.entity: row for row in new})
        return new


def _drawn(doubts: Doubts, view: str, moment: Moment) -> list[Picture | Document]:
    states = doubts.worst()
    gallery = draw_doubtful(states, moment)
    rows: list[Picture | Document] = [draw_conflicts(read_view(view), doubts, moment)]
    return [*rows, *([] if gallery is None else [gallery]), tell_doubtful(states, moment)]


def _same(row: Picture | Document, before: Picture | Document | None) -> bool:
    match row, before:
        case Document(markdown=text), Document():
            return text == before.markdown
        case Picture(image=Indexed(indexes)), Picture(image=Indexed(old)):
            return row.arrows == before.arrows and np.array_equal(indexes, old)
        case _:
            return False
