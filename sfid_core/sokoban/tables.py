"""Every position of a level, numbered without gaps, and where each action leads.

A state's id is rank(boxes) * n_cells + player, over the cells the player could ever reach; the rank of
a set of boxes is its place in the combinatorial number system (Lehmer 1964; Knuth, TAOCP 4A, 7.2.1.3).
Ids whose player shares a box's cell are no positions: they lead to themselves.
"""

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
import numpy.typing as npt

from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.board import BLOCKED, Board, Level

STATES_MAX = 12_000_000
"""Distances of 12 million states take 24 MB; every Boxoban test level (11.5 million at most) fits."""

_ID_MAX = 2**31 - 1


class TooManyStates(ValueError):  # noqa: N818  (named for what happened; callers fall back on it)
    """The level has more positions than a table may hold."""


@dataclass(frozen=True, eq=False)
class StateTable:
    """The numbered positions of one level.

    Attributes:
        level: the level; boxes the player can never reach are part of it, not of the state.
        cells: int16 [n_cells], the level's cell of each compact cell, ascending.
        neighbours: int16 [4, n_cells], compact cell one step on, or -1.
        boxes: int16 [n_boxes, n_ranks], the ascending compact cells of each rank.
    """

    level: Level
    cells: npt.NDArray[np.int16]
    neighbours: npt.NDArray[np.int16]
    boxes: npt.NDArray[np.int16]

    @property
    def n_cells(self) -> int:
        """Return how many cells the player could reach if boxes were no obstacle."""
        return len(self.cells)

    @property
    def n_states(self) -> int:
        """Return the number of ids, those that are no position included."""
        return int(self.boxes.shape[1]) * self.n_cells

    @cached_property
    def successor(self) -> npt.NDArray[np.int32]:
        """Return int32 [n_states, 4]: where each action leads; made at the first call, 16 bytes a state."""
        successor = _walks(self.neighbours, self.boxes.shape[1])
        _add_boxes(successor, self.neighbours, self.boxes)
        return successor.reshape(self.n_states, len(ACTIONS))

    def successors(self, states: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return int64 [n, 4]: where each action leads from the n positions with these ids."""
        rank, player = np.divmod(states, self.n_cells)
        first, rows = states - player, self.boxes.take(rank, axis=1)
        leads = np.empty((len(states), len(ACTIONS)), dtype=np.int64)
        for action in ACTIONS:
            ahead_of = self.neighbours[action]
            target = ahead_of[player]
            leads[:, action] = np.where(target == BLOCKED, states, first + target)
            at = np.flatnonzero((rows == target).any(axis=0))
            origin, near = target[at], rows[:, at]
            landing = ahead_of[origin]
            can = (landing != BLOCKED) & ~(near == landing).any(axis=0)
            pushed = ranks_with_one_moved(near[:, can], origin[can], landing[can], self.n_cells)
            leads[at, action] = states[at]
            leads[at[can], action] = pushed * self.n_cells + origin[can]
        return leads

    def state_id(self, board: Board) -> int:
        """Return the id of a position; ValueError when it is no position of this level's table."""
        compact, still = self.compact, self.still_boxes
        try:
            inside = [compact[box] for box in board.boxes if box not in still]
            player = compact[board.player]
        except KeyError:
            message = "the board has the player or a box where this level has no reachable floor"
            raise ValueError(message) from None
        if len(inside) != len(self.boxes) or len(board.boxes) != len(self.level.boxes) or player in inside:
            message = f"the board is no position of this level with its {len(self.level.boxes)} boxes"
            raise ValueError(message)
        binomials = self._binomials
        rank = sum(binomials[order][cell] for order, cell in enumerate(inside))
        return rank * self.n_cells + player

    def board(self, state_id: int) -> Board:
        """Return the position of an id; ValueError when the id is none."""
        rank, player = divmod(int(state_id), self.n_cells)
        if not 0 <= rank < self.boxes.shape[1] or player in self.boxes[:, rank]:
            message = f"state {state_id} is no position of this level"
            raise ValueError(message)
        boxes = [int(self.cells[box]) for box in self.boxes[:, rank]]
        return Board(self.level, int(self.cells[player]), tuple(sorted((*boxes, *self.still_boxes))))

    @cached_property
    def compact(self) -> dict[int, int]:
        """Return the compact cell of each of the level's cells that the player could reach."""
        return {int(cell): index for index, cell in enumerate(self.cells)}

    @cached_property
    def still_boxes(self) -> tuple[int, ...]:
        """Return, ascending, the level's cells of the boxes that the player can never reach."""
        return tuple(sorted(frozenset(self.level.boxes) - frozenset(self.level.reach)))

    @cached_property
    def _binomials(self) -> list[list[int]]:
        binomials: list[list[int]] = _binomials(self.n_cells, len(self.boxes)).tolist()
        return binomials


def count_states(level: Level) -> int:
    """Return how many ids the table of a level has, without building it."""
    movable = len(set(level.boxes) & set(level.reach))
    return len(level.reach) * comb(len(level.reach), movable)


def build_table(level: Level, states_max: int = STATES_MAX) -> StateTable:
    """Number every position of a level; TooManyStates beyond `states_max`."""
    n_states = count_states(level)
    if n_states > min(states_max, _ID_MAX):
        message = (
            f"the level has {spoken(n_states)} states, more than the limit of {min(states_max, _ID_MAX):,}; "
            "it can be played and taught, but without the optimal teacher, exact deadlocks and drawn starts"
        )
        raise TooManyStates(message)
    compact = {cell: index for index, cell in enumerate(level.reach)}
    neighbours = np.array(
        [[compact.get(level.neighbours[a][cell], BLOCKED) for cell in level.reach] for a in ACTIONS],
        dtype=np.int16,
    )
    boxes = _box_sets(len(level.reach), len(set(level.boxes) & set(level.reach)))
    return StateTable(level, np.array(level.reach, dtype=np.int16), neighbours, boxes)


def ranks_with_one_moved(
    rows: npt.NDArray[np.int16], origin: npt.NDArray[np.int16], landing: npt.NDArray[np.int16], n_cells: int
) -> npt.NDArray[np.int64]:
    """Return the rank of each box set after the box at `origin` went to the free cell `landing`.

    Args: rows: int16 [n_boxes, n], ascending down each column; origin, landing: int16 [n].
    """
    return ranks_of(with_one_moved(rows, origin, landing), n_cells)


def with_one_moved(
    rows: npt.NDArray[np.int16], origin: npt.NDArray[np.int16], landing: npt.NDArray[np.int16]
) -> npt.NDArray[np.int16]:
    """Return the box sets themselves, ascending down each column; arguments as `ranks_with_one_moved`."""
    boxes = np.where(rows == origin, landing, rows)
    # One box moved, so one sweep each way puts the column in order again; far cheaper than a sort.
    for first in range(len(boxes) - 1):
        _order(boxes, first)
    for first in range(len(boxes) - 2, -1, -1):
        _order(boxes, first)
    return boxes


def ranks_of(boxes: npt.NDArray[np.int16], n_cells: int) -> npt.NDArray[np.int64]:
    """Return int64 [n]: the rank of each column of int16 [n_boxes, n], ascending cells below n_cells."""
    binomials = _binomials(n_cells, len(boxes))
    ranks = np.zeros(boxes.shape[1], dtype=np.int64)
    for order, column in enumerate(boxes):
        ranks += binomials[order].take(column)
    return ranks


def _order(boxes: npt.NDArray[np.int16], first: int) -> None:
    lower = np.minimum(boxes[first], boxes[first + 1])
    np.maximum(boxes[first], boxes[first + 1], out=boxes[first + 1])
    boxes[first] = lower


def _binomials(n_cells: int, n_boxes: int) -> npt.NDArray[np.int64]:
    """Return [n_boxes, n_cells]: what the box of each order adds to the rank for each cell."""
    table = [[comb(cell, order + 1) for cell in range(n_cells)] for order in range(n_boxes)]
    return np.array(table, dtype=np.int64).reshape(n_boxes, n_cells)


def _box_sets(n_cells: int, n_boxes: int) -> npt.NDArray[np.int16]:
    """Return int16 [n_boxes, n_ranks]: the box set of each rank, built one box at a time.

    The sets whose greatest box is at cell c are, in order, the first C(c, n - 1) smaller sets and c.
    """
    sets = np.zeros((0, 1), dtype=np.int16)
    for size in range(1, n_boxes + 1):
        counts = [comb(cell, size - 1) for cell in range(n_cells)]
        grown = np.empty((size, sum(counts)), dtype=np.int16)
        grown[-1] = np.repeat(np.arange(n_cells, dtype=np.int16), counts)
        first = 0
        for count in counts:
            grown[:-1, first : first + count] = sets[:, :count]
            first += count
        sets = grown
    return sets


def _walks(neighbours: npt.NDArray[np.int16], n_ranks: int) -> npt.NDArray[np.int32]:
    """Return int32 [n_ranks, n_cells, 4]: where actions lead when no box is near."""
    n_cells = neighbours.shape[1]
    stays = np.arange(n_cells, dtype=np.int32)
    target = np.ascontiguousarray(np.where(neighbours == BLOCKED, stays, neighbours).T, dtype=np.int32)
    first_ids = np.arange(n_ranks, dtype=np.int32) * np.int32(n_cells)
    successor = np.empty((n_ranks, n_cells, len(ACTIONS)), dtype=np.int32)
    np.add(first_ids[:, np.newaxis, np.newaxis], target[np.newaxis], out=successor)
    return successor


def _add_boxes(
    successor: npt.NDArray[np.int32], neighbours: npt.NDArray[np.int16], boxes: npt.NDArray[np.int16]
) -> None:
    """Correct the walks into boxes: pushed, blocked, or no position at all."""
    n_cells = neighbours.shape[1]
    ranks = np.arange(boxes.shape[1])
    for action in ACTIONS:
        behind_of, ahead_of = neighbours[action.opposite], neighbours[action]
        for box in boxes:
            at = np.flatnonzero(behind_of[box] != BLOCKED)
            origin = box[at]
            behind, ahead = behind_of[origin], ahead_of[origin]
            successor[at, behind, action] = at * n_cells + behind
            rows = boxes[:, at]
            can = np.flatnonzero((ahead != BLOCKED) & ~(rows == ahead).any(axis=0))
            moved = ranks_with_one_moved(rows[:, can], origin[can], ahead[can], n_cells)
            successor[at[can], behind[can], action] = moved * n_cells + origin[can]
    for box in boxes:
        successor[ranks, box] = (ranks * n_cells + box)[:, np.newaxis]


def spoken(count: int) -> str:
    """Return a count for a person: digits while they can be read, then a power of ten."""
    digits = int(count.bit_length() * 0.30103)
    return f"{count:,}" if count < 10**15 else f"about 10^{digits}"
