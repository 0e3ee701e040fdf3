"""What one action does to a board."""

from bisect import bisect_left
from typing import NamedTuple

from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.board import BLOCKED, Board


class Move(NamedTuple):
    """The outcome of one action: the next board, and whether the player moved and pushed a box."""

    board: Board
    moved: bool
    pushed: bool


def step(board: Board, action: Action) -> Move:
    """Apply one action; a blocked one leaves the board as it is and still counts as a step."""
    level, boxes = board.level, board.boxes
    ahead = level.neighbours[action]
    target = ahead[board.player]
    if target == BLOCKED:
        return Move(board, moved=False, pushed=False)
    if target not in boxes:
        return Move(Board(level, target, boxes), moved=True, pushed=False)
    landing = ahead[target]
    if landing == BLOCKED or landing in boxes:
        return Move(board, moved=False, pushed=False)
    return Move(Board(level, target, _moved(boxes, target, landing)), moved=True, pushed=True)


def _moved(boxes: tuple[int, ...], origin: int, landing: int) -> tuple[int, ...]:
    """Return the ascending boxes with one of them moved; boxes stay in order, so no full sort."""
    at = bisect_left(boxes, origin)
    rest = boxes[:at] + boxes[at + 1 :]
    to = bisect_left(rest, landing)
    return (*rest[:to], landing, *rest[to:])
