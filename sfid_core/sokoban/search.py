"""A shortest solution from one start, for levels whose positions are too many for a table.

Breadth first over the positions that the start leads to, boxes kept to the cells from which a goal can be
reached: exact, and a small part of all positions.  It knows nothing of positions beside its way.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sfid_core.sokoban.actions import ACTIONS, Action
from sfid_core.sokoban.board import BLOCKED, Board, Level
from sfid_core.sokoban.deadlock import live_cells
from sfid_core.sokoban.tables import TooManyStates, ranks_of, spoken, with_one_moved

SEEN_MAX = 60_000_000
"""Positions visited at most: their ids take 240 MB, and some ten seconds."""
IDS_MAX = 500_000_000
"""One byte marks each id as seen; the system hands out only the pages that are touched."""

_CHUNK = 1 << 17

Cells = npt.NDArray[np.int16]
Ids = npt.NDArray[np.int64]
Layer = npt.NDArray[np.int32]


def shortest(level: Level, seen_max: int = SEEN_MAX) -> tuple[Action, ...] | None:
    """Return a solution of the level's start with the fewest steps, None when there is no solution.

    Raises TooManyStates when that is not known after `seen_max` positions.
    """
    space = _Space(level)
    if not space.solvable_at_all:
        return None
    if space.n_ids > IDS_MAX:
        raise _too_many(f"has {spoken(space.n_ids)} positions, more than the limit of {IDS_MAX:,}")
    layers = _layers(space, seen_max)
    return None if layers is None else _way(space, layers)


class _Frontier(NamedTuple):
    """Positions of one depth: rank int64 [n], player int16 [n], boxes int16 [n_boxes, n] ascending."""

    rank: Ids
    player: Cells
    boxes: Cells


@dataclass(frozen=True)
class _Space:
    """The positions of a level with every box on a live cell, numbered rank(boxes) * n_cells + player."""

    level: Level

    @cached_property
    def cells(self) -> tuple[int, ...]:
        return self.level.reach

    @cached_property
    def compact(self) -> dict[int, int]:
        return {cell: index for index, cell in enumerate(self.cells)}

    @cached_property
    def neighbours(self) -> Cells:
        compact = self.compact
        rows = [[compact.get(ahead[cell], BLOCKED) for cell in self.cells] for ahead in self.level.neighbours]
        return np.array(rows, dtype=np.int16)

    @cached_property
    def place(self) -> Cells:
        """Return int16 [n_cells]: the number of a cell among the live ones, BLOCKED where a box is lost."""
        live = live_cells(self.level)
        place = np.full(len(self.cells), BLOCKED, dtype=np.int16)
        at = [index for index, cell in enumerate(self.cells) if cell in live]
        place[at] = np.arange(len(at), dtype=np.int16)
        return place

    @cached_property
    def n_live(self) -> int:
        return int((self.place != BLOCKED).sum())

    @cached_property
    def goals(self) -> tuple[int, ...]:
        """Return, ascending, the compact cells of the goals within reach."""
        return tuple(self.compact[goal] for goal in self.level.goals if goal in self.compact)

    @property
    def n_ids(self) -> int:
        return comb(self.n_live, len(self.goals)) * len(self.cells)

    @property
    def solvable_at_all(self) -> bool:
        """Tell whether goals and boxes within reach are as many and every box is on a live cell."""
        boxes = [self.compact[box] for box in self.level.boxes if box in self.compact]
        still = [box for box in self.level.boxes if box not in self.compact]
        return (
            self.level.goal_set.issuperset(still)
            and len(boxes) == len(self.goals)
            and all(self.place[box] != BLOCKED for box in boxes)
        )

    def frontier(self, board: Board) -> _Frontier:
        boxes = [[self.compact[box]] for box in board.boxes if box in self.compact]
        rows = np.array(boxes, dtype=np.int16).reshape(len(boxes), 1)
        return _Frontier(self.ranks(rows), np.array([self.compact[board.player]], dtype=np.int16), rows)

    def ranks(self, boxes: Cells) -> Ids:
        return ranks_of(self.place[boxes], self.n_live)

    def ids(self, some: _Frontier) -> Ids:
        return some.rank * len(self.cells) + some.player

    def id_of(self, board: Board) -> int:
        """Return the id of a board, -1 when a box of it stands on a cell that is not live."""
        boxes = [self.compact[box] for box in board.boxes if box in self.compact]
        if any(self.place[box] == BLOCKED for box in boxes):
            return -1
        return int(self.ids(self.frontier(board))[0])

    def after(self, some: _Frontier, action: Action) -> Iterator[_Frontier]:
        """Yield where an action leads, first by walks, then by pushes; neither names a position twice."""
        ahead = self.neighbours[action]
        target = ahead[some.player]
        pushes = (some.boxes == target).any(axis=0)
        at = np.flatnonzero((target != BLOCKED) & ~pushes)
        yield _Frontier(some.rank[at], target[at], some.boxes[:, at])
        at = np.flatnonzero(pushes)
        landing = ahead[target[at]]
        at = at[(landing != BLOCKED) & (self.place[landing] != BLOCKED)]
        landing = ahead[target[at]]
        at = at[~(some.boxes[:, at] == landing).any(axis=0)]
        origin = target[at]
        boxes = with_one_moved(some.boxes[:, at], origin, ahead[origin])
        yield _Frontier(self.ranks(boxes), origin, boxes)


def _layers(space: _Space, seen_max: int) -> list[Layer] | None:
    """Return the ids first reached at each depth, the last of them with a solved one; None without one."""
    solved = int(ranks_of(space.place[np.array(space.goals, dtype=np.int16)][:, np.newaxis], space.n_live)[0])
    seen = np.zeros(space.n_ids, dtype=np.bool_)
    frontier = space.frontier(space.level.start)
    layers = [space.ids(frontier).astype(np.int32)]
    seen[layers[0]] = True
    count = 1
    while not (frontier.rank == solved).any():
        frontier = _joined(list(_fresh(space, frontier, seen)))
        count += len(frontier.rank)
        if not len(frontier.rank):
            return None
        if count > seen_max:
            raise _too_many(f"is not solved in {len(layers)} steps, after {seen_max:,} positions")
        layers.append(space.ids(frontier).astype(np.int32))
    return layers


def _fresh(space: _Space, frontier: _Frontier, seen: npt.NDArray[np.bool_]) -> Iterator[_Frontier]:
    """Yield, in parts, the positions one step on that were not seen before, and mark them as seen."""
    for first in range(0, len(frontier.rank), _CHUNK):
        rows = slice(first, first + _CHUNK)
        part = _Frontier(frontier.rank[rows], frontier.player[rows], frontier.boxes[:, rows])
        for action in ACTIONS:
            for reached in space.after(part, action):
                ids = space.ids(reached)
                at = np.flatnonzero(~seen[ids])
                seen[ids[at]] = True
                yield _Frontier(reached.rank[at], reached.player[at], reached.boxes[:, at])


def _joined(parts: list[_Frontier]) -> _Frontier:
    """Return the parts of one depth as one; there are always some, though they may be empty."""
    return _Frontier(
        np.concatenate([part.rank for part in parts]),
        np.concatenate([part.player for part in parts]),
        np.concatenate([part.boxes for part in parts], axis=1),
    )


def _way(space: _Space, layers: list[Layer]) -> tuple[Action, ...]:
    """Return the actions from the start to a solved position of the last layer, found from its end."""
    board = _solved_board(space, layers[-1])
    actions: list[Action] = []
    for layer in reversed(layers[:-1]):
        board, action = next(found for found in _before(board) if _has(layer, space, found[0]))
        actions.append(action)
    return tuple(reversed(actions))


def _solved_board(space: _Space, layer: Layer) -> Board:
    level = space.level
    solved = (level.start.with_state(player, level.goals) for player in level.reach)
    return next(board for board in solved if board.player not in level.goal_set and _has(layer, space, board))


def _has(layer: Layer, space: _Space, board: Board) -> bool:
    return bool((layer == space.id_of(board)).any())


def _before(board: Board) -> Iterator[tuple[Board, Action]]:
    """Yield each board from which one action leads here, with the action."""
    level = board.level
    for action in ACTIONS:
        behind = level.neighbours[action.opposite][board.player]
        if behind == BLOCKED or behind in board.boxes:
            continue
        yield board.with_state(behind, board.boxes), action
        ahead = level.neighbours[action][board.player]
        if ahead in board.boxes:
            rest = (box for box in board.boxes if box != ahead)
            yield board.with_state(behind, (*rest, board.player)), action


def _too_many(what: str) -> TooManyStates:
    return TooManyStates(f"the level {what}; take away a box or some floor")
