"""What tests read back: solutions out of letters, and which ids of a table are positions."""

import numpy as np
import numpy.typing as npt

from sfid_core.sokoban.actions import ACTIONS, LETTERS, Action
from sfid_core.sokoban.board import Board, Level
from sfid_core.sokoban.solver import Solution
from sfid_core.sokoban.starts import StartDistribution, Starts
from sfid_core.sokoban.tables import StateTable


def from_lurd(text: str) -> tuple[Action, ...]:
    """Return the actions of a solution's letters, walks and pushes alike."""
    return tuple(ACTIONS[LETTERS.index(letter)] for letter in text.lower())


def positions(table: StateTable) -> npt.NDArray[np.bool_]:
    """Return bool [n_states]: False where the id puts the player into a box."""
    free = np.ones((table.boxes.shape[1], table.n_cells), dtype=np.bool_)
    for box in table.boxes:
        free[np.arange(len(box)), box] = False
    return free.reshape(-1)


def start_states(level: Level, solution: Solution, spec: Starts, key: int) -> tuple[Board, ...]:
    """Return every start of a distribution."""
    starts = StartDistribution(level, solution, spec, key)
    return tuple(starts.board(index) for index in range(len(starts)))
