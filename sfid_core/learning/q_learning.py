"""Tabular Q-learning: the greedy choice and the update that every Q-based method shares."""

from collections.abc import Sequence
from typing import NamedTuple

from sfid_core.chance import below


class TDErrors(NamedTuple):
    """The two temporal-difference errors of one update."""

    environment: float
    """delta of Eq. 2: r + gamma max Q(s', .) - Q(s, a), without the teacher's part."""
    shaped: float
    """delta of Eq. 4: (r + h) + gamma max Q(s', .) - Q(s, a), by which Q moves."""


def greedy(values: Sequence[float], key: int, counter: int) -> int:
    """Return the index of the largest value, ties drawn uniformly at position `counter` of the stream `key`.

    Source: Raza, Johnston & Williams 2016, Algorithms 1 and 2 (with Q = 0 at first, a new state gives a
    random action).
    """
    best = max(values)
    ties = [action for action, value in enumerate(values) if value == best]
    return ties[0] if len(ties) == 1 else ties[below(key, counter, len(ties))]


def update(
    row: list[float], action: int, reward: float, h: float, next_max: float, alpha: float, gamma: float
) -> TDErrors:
    """Move Q(s, a) by alpha times the shaped TD error, in place.

    Args: row: float64 values of s; reward: r of the environment; h: the teacher's part, 0 for silence;
    next_max: max Q(s', .), 0 where s' is terminal; alpha in (0, 1]; gamma in [0, 1).
    Source: Watkins & Dayan 1992; Raza, Johnston & Williams 2016, Eq. 2 and 4.
    """
    environment = reward + gamma * next_max - row[action]
    shaped = environment + h
    row[action] += alpha * shaped
    return TDErrors(environment, shaped)
