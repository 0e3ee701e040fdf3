"""The agent's policy and values over the floor, as far as the monitor has seen them learnt."""

from collections import OrderedDict

import numpy as np

from services import tiles
from services.monitor.rows import Arrow, Indexed, Moment, Picture
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.board import Board

ENTITY = "policy"
ROWS_MAX = 200_000
"""Rows of Q remembered: about 60 MB; the founding task has 600. The row learnt longest ago goes first."""
TIE = 1e-9
"""Best and second-best closer than this: no arrow, the agent would draw lots."""


class ValueMirror:
    """The rows Q(s, .) that learnt steps have carried by.

    A monitor that starts late, or misses messages, knows less than the learner; it shows what it has seen.
    """

    __slots__ = ("_rows", "_rows_max")

    def __init__(self, rows_max: int = ROWS_MAX) -> None:
        self._rows: OrderedDict[bytes, tuple[float, ...]] = OrderedDict()
        self._rows_max = rows_max

    def __len__(self) -> int:
        return len(self._rows)

    def learn(self, state: bytes, values: tuple[float, ...]) -> None:
        """Remember the row of a state as it is after the step."""
        self._rows[state] = values
        self._rows.move_to_end(state)
        if len(self._rows) > self._rows_max:
            self._rows.popitem(last=False)

    def around(self, board: Board) -> dict[int, tuple[float, ...]]:
        """Return the known rows by the cell the player would stand on, boxes as they are on the board."""
        free = (cell for cell in board.level.reach if cell not in board.boxes)
        rows = ((cell, self._rows.get(board.with_state(cell, board.boxes).state_key())) for cell in free)
        return {cell: row for cell, row in rows if row is not None and len(row) == len(ACTIONS)}


def draw_policy(board: Board, mirror: ValueMirror, moment: Moment) -> Picture:
    """Return the floor coloured by value, lowest of those shown dark, with an arrow for each best action."""
    rows = mirror.around(board)
    level = board.level
    indexes = tiles.background(level)
    indexes += np.uint8(tiles.DIMMED)
    best = {cell: max(row) for cell, row in rows.items()}
    lowest, highest = min(best.values(), default=0.0), max(best.values(), default=0.0)
    for cell, value in best.items():
        share = (value - lowest) / (highest - lowest) if highest > lowest else 0.0
        tiles.cell_view(indexes, level, cell)[1:-1, 1:-1] = tiles.VALUES + round(
            share * (tiles.VALUE_COLOURS - 1)
        )
    for goal in set(level.goals) & set(rows):
        tiles.put(indexes, level, goal, tiles.GOAL)
    tiles.draw_boxes(indexes, board)
    arrows = tuple(arrow for cell, row in rows.items() if (arrow := _arrow(board, cell, row)) is not None)
    return Picture(ENTITY, moment, Indexed(indexes, tiles.palette()), arrows)


def _arrow(board: Board, cell: int, row: tuple[float, ...]) -> Arrow | None:
    """The best action of a cell; fainter where the second-best is nearly as good."""
    ranked = sorted(row, reverse=True)
    gap = ranked[0] - ranked[1]
    if gap < TIE:
        return None
    certainty = min(1.0, gap / (abs(ranked[0]) * 0.25 + TIE))
    down, right = ACTIONS[row.index(ranked[0])].delta
    y, x = divmod(cell, board.level.width)
    length = 0.6 * tiles.TILE
    origin = ((x + 0.5) * tiles.TILE - right * length / 2, (y + 0.5) * tiles.TILE - down * length / 2)
    return Arrow(
        origin, (right * length, down * length), (255, 255, 255), width=2.4, opacity=0.35 + 0.65 * certainty
    )
