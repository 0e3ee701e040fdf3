"""The finished episodes of a session, packed: a learner keeps thousands of sessions of many episodes."""

from collections.abc import Iterator
from struct import Struct
from typing import NamedTuple

from sfid_core.outcome import Outcome
from sfid_core.session.measures import EpisodeMeasures

_ROW = Struct("<qQIiddddIIB")
"""65 bytes, where the objects take some 330: at_ns, decision, and the measures in their order but for the
number of the episode, which is its place."""
_OUTCOMES = tuple(Outcome)
_UNKNOWN_STEPS = -1


class Ended(NamedTuple):
    """A finished episode: when it ended, and the first decision after it."""

    at_ns: int
    decision: int
    measures: EpisodeMeasures


class EpisodeLog:
    """Finished episodes in their order; read as a sequence, it yields their measures."""

    __slots__ = ("_rows",)

    def __init__(self) -> None:
        self._rows = bytearray()

    def append(self, at_ns: int, decision: int, measures: EpisodeMeasures) -> None:
        """Add the episode that ended just now, the next by number; `decision` is the first one after it."""
        steps = _UNKNOWN_STEPS if measures.optimal_steps is None else measures.optimal_steps
        self._rows += _ROW.pack(
            at_ns,
            decision,
            measures.steps,
            steps,
            measures.abs_td_error,
            measures.abs_td_error_shaped,
            measures.discounted_return,
            measures.discounted_env_return,
            measures.inputs,
            measures.agreements,
            _OUTCOMES.index(measures.outcome),
        )

    def ended(self, first: int, count: int) -> tuple[Ended, ...]:
        """Return up to `count` episodes from number `first` (0 or more) on, with when each ended."""
        return tuple(self._at(number) for number in range(first, min(first + count, len(self))))

    def __len__(self) -> int:
        """Return the number of finished episodes."""
        return len(self._rows) // _ROW.size

    def __getitem__(self, number: int) -> EpisodeMeasures:
        """Return the measures of an episode, from the end for a negative number; raise IndexError."""
        place = number + len(self) if number < 0 else number
        if not 0 <= place < len(self):
            message = f"episode {number} of {len(self)}"
            raise IndexError(message)
        return self._at(place).measures

    def __iter__(self) -> Iterator[EpisodeMeasures]:
        """Yield the measures of each episode."""
        return (self._at(number).measures for number in range(len(self)))

    def __eq__(self, other: object) -> bool:
        """Tell whether another log tells of the same episodes, ended at the same times."""
        return isinstance(other, EpisodeLog) and self._rows == other._rows

    def __hash__(self) -> int:
        """Refuse: it grows."""
        message = "a log of episodes grows: hash a tuple of it"
        raise TypeError(message)

    def _at(self, number: int) -> Ended:
        row = _ROW.unpack_from(self._rows, number * _ROW.size)
        at_ns, decision, steps, optimal = row[:4]
        td_error, shaped, discounted, environment, inputs, agreements, outcome = row[4:]
        measures = EpisodeMeasures(
            number,
            steps,
            None if optimal == _UNKNOWN_STEPS else optimal,
            td_error,
            shaped,
            discounted,
            environment,
            inputs,
            agreements,
            _OUTCOMES[outcome],
        )
        return Ended(at_ns, decision, measures)
