"""A finite, deterministic world as tables: what every batch learner works on."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt


class StateOutcome(IntEnum):
    """What it means to be in a state of a table."""

    RUNNING = 0
    SOLVED = 1
    DEADLOCK = 2


@dataclass(frozen=True, eq=False)
class TabularMDP:
    """A deterministic world: successor[s, a] follows action a in state s and pays reward[s, a].

    Args:
        successor: int32 [n_states, n_actions], each in [0, n_states); a terminal state leads to itself.
        reward: float64 [n_states, n_actions], paid on the way out of s; finite, 0 in a terminal state.
        outcome: uint8 [n_states], a StateOutcome; SOLVED and DEADLOCK states are terminal.

    The tables are made read-only.  Raises ValueError, naming the table and the first state at fault.
    """

    successor: npt.NDArray[np.int32]
    reward: npt.NDArray[np.float64]
    outcome: npt.NDArray[np.uint8]

    def __post_init__(self) -> None:
        _check_form("successor", self.successor, np.dtype(np.int32), 2)
        _check_form("reward", self.reward, np.dtype(np.float64), 2)
        _check_form("outcome", self.outcome, np.dtype(np.uint8), 1)
        if self.reward.shape != self.successor.shape or self.outcome.shape != self.successor.shape[:1]:
            message = (
                f"tables disagree: successor {self.successor.shape}, reward {self.reward.shape}, "
                f"outcome {self.outcome.shape}; give [n, k], [n, k] and [n]"
            )
            raise ValueError(message)
        self._check_values()
        for table in (self.successor, self.reward, self.outcome):
            table.flags.writeable = False

    @property
    def n_states(self) -> int:
        """Return the number of states, terminal ones included."""
        return int(self.successor.shape[0])

    @property
    def n_actions(self) -> int:
        """Return the number of actions in every state."""
        return int(self.successor.shape[1])

    def _check_values(self) -> None:
        outside = (self.successor.min(axis=1) < 0) | (self.successor.max(axis=1) >= self.n_states)
        _refuse_any(outside, f"successor is outside 0..{self.n_states - 1}")
        _refuse_any(~np.isfinite(self.reward.sum(axis=1)), "reward is not finite")
        _refuse_any(self.outcome > max(StateOutcome), "outcome is none of 0, 1 and 2")
        ended = np.flatnonzero(self.outcome != StateOutcome.RUNNING)
        leaving = np.zeros(self.n_states, dtype=np.bool_)
        leaving[ended] = (self.successor[ended] != ended[:, np.newaxis]).any(axis=1)
        _refuse_any(leaving, "a terminal state does not lead to itself")
        leaving[ended] = (self.reward[ended] != 0).any(axis=1)
        _refuse_any(leaving, "a terminal state pays a reward")


def _check_form(name: str, table: npt.NDArray[Any], dtype: np.dtype[Any], ndim: int) -> None:
    if table.dtype != dtype or table.ndim != ndim:
        message = f"{name} is {table.dtype} with {table.ndim} axes; give {dtype} with {ndim}"
        raise ValueError(message)
    if not table.size:
        message = f"{name} is empty; give at least one state and one action"
        raise ValueError(message)


def _refuse_any(faulty: npt.NDArray[np.bool_], what: str) -> None:
    if faulty.any():
        message = f"{what}, first in state {int(faulty.argmax())}"
        raise ValueError(message)
