"""The exact oracle: how many steps every position of a level is from solved."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from sfid_core.sokoban.actions import ACTIONS, Action
from sfid_core.sokoban.board import BLOCKED, Board, Level
from sfid_core.sokoban.rules import step
from sfid_core.sokoban.tables import STATES_MAX, StateTable, build_table, ranks_with_one_moved

DEADLOCKED = -1

_CHUNK = 1 << 17
"""States expanded at once: the temporaries of one chunk stay within a few megabytes."""

StateIds = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Solution:
    """Exact distances of every state of a level to solved.

    Attributes:
        table: the numbered states.
        steps: int16 or int32 [n_states], the fewest steps to solved, 0 when solved, -1 when deadlocked
            (or when the id is no position).
    """

    table: StateTable
    steps: npt.NDArray[np.int16] | npt.NDArray[np.int32]

    def distance(self, board: Board) -> int | None:
        """Return the fewest steps from a position to solved, None when it cannot be solved."""
        steps = self.steps.item(self.table.state_id(board))
        return None if steps == DEADLOCKED else steps

    def deadlocked(self, board: Board) -> bool:
        """Tell whether no sequence of actions solves this position."""
        return self.distance(board) is None

    def optimal_actions(self, board: Board) -> tuple[Action, ...]:
        """Return, in index order, every action that begins a shortest solution; none when solved or dead."""
        state_id = self.table.state_id(board)
        nearer = self.steps.item(state_id) - 1
        if nearer < 0:
            return ()
        compact = self.table.compact
        walked = state_id - compact[board.player]
        best = []
        for action, ahead in zip(ACTIONS, self.table.level.neighbours, strict=True):
            target = ahead[board.player]
            if target == BLOCKED:
                continue
            # A walk keeps the rank of the boxes; only pushes are worth the price of a board.
            after = self._pushed(board, action) if target in board.boxes else walked + compact[target]
            if self.steps.item(after) == nearer:
                best.append(action)
        return tuple(best)

    def solution(self, board: Board) -> tuple[Action, ...]:
        """Return a shortest solution, at each choice the action first in index order.

        Raises ValueError when the position cannot be solved.
        """
        if self.deadlocked(board):
            message = "the position cannot be solved; ask `deadlocked` first"
            raise ValueError(message)
        actions = []
        while best := self.optimal_actions(board):
            actions.append(best[0])
            board = step(board, best[0]).board
        return tuple(actions)

    def solvable_states(self) -> StateIds:
        """Return, ascending and read-only, the ids of all that can be solved and is not solved yet."""
        return self._solvable

    @cached_property
    def _solvable(self) -> StateIds:
        found = np.flatnonzero(self.steps > 0)
        found.setflags(write=False)  # all worlds of the level draw their starts from this one
        return found

    def _pushed(self, board: Board, action: Action) -> int:
        return self.table.state_id(step(board, action).board)

    @cached_property
    def longest(self) -> int:
        """Return the greatest distance of any solvable placement, 0 when there is none."""
        return max(int(self.steps.max(initial=0)), 0)


def solve(level: Level, states_max: int = STATES_MAX) -> Solution:
    """Compute the exact distance of every state; raises TooManyStates beyond `states_max`.

    Breadth first from the solved states along moves and pushes taken back.
    """
    table = build_table(level, states_max)
    steps: npt.NDArray[np.int16] | npt.NDArray[np.int32]
    steps = np.full(table.n_states, DEADLOCKED, dtype=np.int16)
    frontier = _solved_states(table)
    depth = 0
    steps[frontier] = depth
    while frontier.size:
        depth += 1
        if depth == np.iinfo(np.int16).max:
            steps = steps.astype(np.int32)
        fresh = []
        for first in range(0, len(frontier), _CHUNK):
            for states in _predecessors(table, frontier[first : first + _CHUNK]):
                # No stream of predecessors names a state twice, so marking as we go keeps the next
                # frontier free of doubles without a sort.
                unseen = states[steps[states] == DEADLOCKED]
                steps[unseen] = depth
                fresh.append(unseen)
        frontier = np.concatenate(fresh)
    return Solution(table, steps)


def _solved_states(table: StateTable) -> StateIds:
    level = table.level
    reach = set(level.reach)
    if not level.goal_set.issuperset(box for box in level.boxes if box not in reach):
        return np.zeros(0, dtype=np.int64)
    goals = np.isin(table.cells, np.array(level.goals))
    ranks = np.flatnonzero(goals[table.boxes].all(axis=0))
    ids = (ranks[:, np.newaxis] * table.n_cells + np.arange(table.n_cells)).reshape(-1)
    players = ids % table.n_cells
    taken = (table.boxes[:, ids // table.n_cells] == players).any(axis=0)
    solved: StateIds = ids[~taken]
    return solved


def _predecessors(table: StateTable, states: StateIds) -> Iterator[StateIds]:
    """Yield, for each action, the states from which it leads here: by a walk, then by a push."""
    rank, player = np.divmod(states, table.n_cells)
    first, rows = states - player, table.boxes.take(rank, axis=1)
    for action in ACTIONS:
        behind = table.neighbours[action.opposite][player]
        at = np.flatnonzero((behind != BLOCKED) & ~(rows == behind).any(axis=0))
        yield first[at] + behind[at]
        ahead = table.neighbours[action][player]
        # Walking back takes a box along where one stands ahead; no box stands at BLOCKED.
        at = at[(rows == ahead).any(axis=0)[at]]
        if at.size:
            pulled = ranks_with_one_moved(rows[:, at], ahead[at], player[at].astype(np.int16), table.n_cells)
            yield pulled * table.n_cells + behind[at]
