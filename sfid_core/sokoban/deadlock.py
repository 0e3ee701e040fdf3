"""Deadlocks seen without solving: sound, not complete, for levels with too many states to solve.

Three tests, each a proof: a box stands where no pull from any goal arrives; boxes block each other for
good and one of them is off its goal; no box can be pushed at all.
"""

from functools import lru_cache

from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.board import BLOCKED, Board, Level

_AXES = ((0, 1), (2, 3))
"""Pairs of opposite actions: a box is pushed along one of them."""


def surely_deadlocked(board: Board) -> bool:
    """Tell whether a proof was found that the position cannot be solved; False proves nothing."""
    if board.solved:
        return False
    alive = live_cells(board.level)
    if not alive.issuperset(board.boxes):
        return True
    if any(box not in board.level.goal_set for box in _frozen(board, alive)):
        return True
    return not _can_push(board)


@lru_cache(maxsize=256)
def live_cells(level: Level) -> frozenset[int]:
    """Return the cells from which one box, alone on the level, could be pushed to some goal.

    A goal holds a box that is there already, so every goal is live, within the player's reach or not.
    """
    reach = frozenset(level.reach)
    alive = set(level.goals)
    open_cells = [goal for goal in level.goals if goal in reach]
    while open_cells:
        cell = open_cells.pop()
        for ahead in level.neighbours:
            pulled_to = ahead[cell]
            player_to = BLOCKED if pulled_to == BLOCKED else ahead[pulled_to]
            if player_to in reach and pulled_to not in alive:
                alive.add(pulled_to)
                open_cells.append(pulled_to)
    return frozenset(alive)


def _frozen(board: Board, alive: frozenset[int]) -> set[int]:
    """Return the boxes none of which can be the first of them to move to a live cell.

    The greatest such set: starting from all boxes, drop each that is not held on both axes by walls, by
    dead cells on both sides or by boxes still in the set.
    """
    held = set(board.boxes)
    while True:
        loose = {box for box in held if not all(_held(board.level, box, axis, held, alive) for axis in _AXES)}
        if not loose:
            return held
        held -= loose


def _held(level: Level, box: int, axis: tuple[int, int], held: set[int], alive: frozenset[int]) -> bool:
    sides = [level.neighbours[action][box] for action in axis]
    if any(side == BLOCKED or side in held for side in sides):
        return True
    return alive.isdisjoint(sides)


def _can_push(board: Board) -> bool:
    level, boxes = board.level, set(board.boxes)
    seen = {board.player}
    open_cells = [board.player]
    while open_cells:
        cell = open_cells.pop()
        for action in ACTIONS:
            target = level.neighbours[action][cell]
            if target in boxes:
                landing = level.neighbours[action][target]
                if landing != BLOCKED and landing not in boxes:
                    return True
            elif target != BLOCKED and target not in seen:
                seen.add(target)
                open_cells.append(target)
    return False
