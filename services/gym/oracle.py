"""What is best in each state of an environment that tells its transitions (`env.unwrapped.P`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

GAMMA = 0.99
"""Discount factor of the oracle: near enough to 1 that it takes the safe way over slippery ice."""
TOLERANCE = 1e-10
TIE = 1e-7
"""Actions closer than this share of the largest value are equally good."""
SWEEPS_MAX = 20_000

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Transitions:
    """A transition table as arrays.

    Attributes:
        probability: float64 [states, actions, outcomes]; 0 where an action has fewer outcomes than others.
        successor: int64, same shape.
        reward: float64, same shape.
        ends: bool, same shape: the episode ends there, and no value lies beyond.
    """

    probability: Floats
    successor: npt.NDArray[np.int64]
    reward: Floats
    ends: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, table: Mapping[int, Mapping[int, Sequence[tuple[float, int, float, bool]]]]) -> "Transitions":
        """Return the arrays of a table P[state][action] = [(probability, successor, reward, ends), ...].

        Raises: KeyError, ValueError when states or actions are not numbered from 0 or rows are no such rows.
        """
        states, actions = len(table), len(table[0])
        widest = max(len(row) for by_action in table.values() for row in by_action.values())
        shape = (states, actions, widest)
        found = cls(np.zeros(shape), np.zeros(shape, np.int64), np.zeros(shape), np.zeros(shape, np.bool_))
        for state in range(states):
            for action in range(actions):
                for number, (probability, successor, reward, ends) in enumerate(table[state][action]):
                    at = state, action, number
                    found.probability[at], found.successor[at] = probability, successor
                    found.reward[at], found.ends[at] = reward, ends
        return found

    @cached_property
    def best_ending(self) -> float:
        """The largest reward that ends an episode; -inf when none does."""
        ends = self.ends & (self.probability > 0)
        return float(self.reward[ends].max()) if ends.any() else -np.inf

    @cached_property
    def step_reward(self) -> float:
        """The largest reward of a step that does not end an episode; 0 when every step does."""
        goes_on = ~self.ends & (self.probability > 0)
        return float(self.reward[goes_on].max()) if goes_on.any() else 0.0

    @cached_property
    def is_certain(self) -> bool:
        """Whether each action has one outcome."""
        return bool(((self.probability > 0).sum(axis=2) == 1).all())

    def worths(self, values: Floats, gamma: float) -> Floats:
        """Return float64 [states, actions]: what each action is worth when `values` are the states'."""
        ahead = np.where(self.ends, 0.0, values[self.successor])
        worth: Floats = (self.probability * (self.reward + gamma * ahead)).sum(axis=2)
        return worth

    def solve(self, gamma: float = GAMMA) -> Floats:
        """Return the optimal action values [states, actions] by value iteration (Bellman 1957)."""
        values = np.zeros(self.reward.shape[0])
        for _ in range(SWEEPS_MAX):
            worths = self.worths(values, gamma)
            new = worths.max(axis=1)
            if np.abs(new - values).max() <= TOLERANCE * (1.0 + np.abs(new).max()):
                return worths
            values = new
        return self.worths(values, gamma)

    def evaluate(self, policy: npt.NDArray[np.int64], gamma: float) -> Floats:
        """Return float64 [states]: what always taking `policy[state]` is worth."""
        values = np.zeros(len(policy))
        for _ in range(SWEEPS_MAX):
            new = self.worths(values, gamma)[np.arange(len(policy)), policy]
            if np.abs(new - values).max() <= TOLERANCE * (1.0 + np.abs(new).max()):
                return new
            values = new
        return values

    def fewest_steps(self) -> npt.NDArray[np.int64]:
        """Return int64 [states]: steps to the best ending, -1 where no way leads there.

        Meant for tables that are certain: elsewhere it is what luck would need.
        """
        likely = self.probability > 0
        well = (likely & self.ends & (self.reward == self.best_ending)).any(axis=(1, 2))
        steps = np.where(well, 1, -1)
        walks = likely & ~self.ends
        for distance in range(2, len(steps) + 1):
            near = (walks & (steps[self.successor] == distance - 1)).any(axis=(1, 2)) & (steps < 0)
            if not near.any():
                break
            steps[near] = distance
        return steps


def optimal_actions(worths: Floats) -> tuple[tuple[int, ...], ...]:
    """Return for each state the indexes of its best actions, ties included."""
    best = worths.max(axis=1, keepdims=True)
    close = worths >= best - TIE * (1.0 + np.abs(best))
    return tuple(tuple(int(action) for action in np.flatnonzero(row)) for row in close)


def table_of(environment: Any) -> Transitions | None:  # noqa: ANN401 - any environment
    """Return the transitions of an environment that tells them about observed numbers, None elsewhere."""
    table = getattr(environment.unwrapped, "P", None)
    states = getattr(environment.observation_space, "n", None)
    if not isinstance(table, Mapping) or states is None or len(table) != int(states):
        return None
    try:
        return Transitions.of(table)
    except (KeyError, ValueError, TypeError, IndexError):
        return None
