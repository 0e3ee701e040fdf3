"""What can happen to messages, as data and as draws."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

MS = 1_000_000


@dataclass(frozen=True, slots=True)
class Faults:
    """What may happen to a message: probabilities in [0, 1], spans in ms."""

    drop: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    """A publication that may overtake, or be overtaken; requests and replies have no order to lose."""
    slow: float = 0.0
    """A message that takes up to `slow_ms`, which may be longer than its asker waits."""
    delay_ms: float = 0.2
    slow_ms: float = 900.0
    presence_ms: float = 2.0
    """How long who came and who went may take to be told."""


CALM = Faults()


class Seen(NamedTuple):
    """One thing that happened on the hub, for observers; a named tuple, because there are very many."""

    at_ns: int
    what: str
    """publish, hear, ask, serve, reply, error, answered, unanswered; present, gone; lost, again, cut ..."""
    sender: str
    receiver: str
    key: str
    payload: bytes
    ask: int = 0
    """Number of the question that this belongs to."""


Observer = Callable[[Seen], None]


class Link:
    """Chance and order of what one bus sends to another."""

    def __init__(self, chance: Random) -> None:
        self._chance = chance
        self._last_ns = 0

    def copies(self, faults: Faults) -> int:
        """Draw how often a message arrives."""
        if not faults.drop and not faults.duplicate:
            return 1
        drawn = self._chance.random()
        if drawn < faults.drop:
            return 0
        return 2 if drawn < faults.drop + faults.duplicate else 1

    def arrival_ns(self, faults: Faults, now_ns: int, *, ordered: bool) -> int:
        """Draw when it arrives."""
        bound_ms = faults.delay_ms
        if faults.slow and self._chance.random() < faults.slow:
            bound_ms = faults.slow_ms
        at_ns = now_ns + 20_000 + int(self._chance.random() * bound_ms * MS)
        if not faults.reorder or (ordered and self._chance.random() >= faults.reorder):
            at_ns = self._last_ns = max(at_ns, self._last_ns)
        return at_ns
