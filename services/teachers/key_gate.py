"""Which key press becomes an answer. A pure machine: presses and times in, verdicts out.

The rule, in four sentences:
1. A press counts only for the decision that was on screen when it was pressed, and only one counts for it.
2. A press while no decision on screen asks for an answer is dropped, never kept for the next one.
3. The same key again within REPEAT_MS of its event before is a held key repeating, and is dropped.
4. A keyboard waits before it begins to repeat, so the same key again within HOLD_MS of its first event may
   be a finger or a held key: such a press counts once CONFIRM_MS have passed without another one of that key.

A terminal sends no key-up events, over SSH least of all, so times are all there is. The cost of rule 4: a
label which repeats the one before counts 150 ms later; its decision and its response time stay those of the
press.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

REPEAT_MS = 150
"""Held keys repeat every 25 to 100 ms; fingers tap one key at most about every 150 ms."""
HOLD_MS = 1100
"""The wait before repeating is 250 to 1000 ms on the desktops and consoles we know."""
CONFIRM_MS = 150
_TO_NS = 1_000_000

D = TypeVar("D")


class Verdict(Enum):
    """What became of a press."""

    COUNTS = "counts"
    WAITS = "waits"
    """Counts unless the key turns out to be held: ask `confirmed`."""
    HELD = "held"
    """A held key repeating."""
    ALREADY = "already"
    """This decision has its answer."""
    CLOSED = "closed"
    """No decision on screen asks for one."""


@dataclass(slots=True)
class _Waiting(Generic[D]):
    decision: D
    key: str
    pressed_ns: int


@dataclass(frozen=True, slots=True)
class Press(Generic[D]):
    """A press that counts: the decision it is for, the key, and when it was pressed."""

    decision: D
    key: str
    pressed_ns: int


class KeyGate(Generic[D]):
    """The keys of one teacher. A decision is anything that can be compared."""

    def __init__(self) -> None:
        self._shown: D | None = None
        self._answered: D | None = None
        self._last_key = ""
        self._last_ns = 0
        self._began_ns = 0
        self._waiting: _Waiting[D] | None = None

    def show(self, decision: D | None) -> None:
        """Note which decision is on screen and asks for an answer; None when none does."""
        self._shown = decision

    def answered(self, decision: D) -> None:
        """Note that a decision has its answer, given in another way than by a press here."""
        self._answered = decision

    def press(self, key: str, now_ns: int) -> Verdict:
        """Judge one press."""
        gap_ns = now_ns - self._last_ns if key == self._last_key else None
        since_began_ns = now_ns - self._began_ns
        self._last_key, self._last_ns = key, now_ns
        if gap_ns is not None and gap_ns <= REPEAT_MS * _TO_NS:
            if self._waiting is not None and self._waiting.key == key:
                self._waiting = None
            return Verdict.HELD
        self._began_ns = now_ns
        if self._shown is None:
            return Verdict.CLOSED
        if self._shown in {self._answered, self._waiting and self._waiting.decision}:
            return Verdict.ALREADY
        if gap_ns is not None and since_began_ns <= HOLD_MS * _TO_NS:
            self._waiting = _Waiting(self._shown, key, now_ns)
            return Verdict.WAITS
        self._answered = self._shown
        return Verdict.COUNTS

    @property
    def waits(self) -> bool:
        """Whether a press may still count: ask `confirmed`, again if need be."""
        return self._waiting is not None

    def confirmed(self, now_ns: int) -> Press[D] | None:
        """Return the waiting press once it is known that its key is not held."""
        waiting = self._waiting
        if waiting is None or now_ns < waiting.pressed_ns + CONFIRM_MS * _TO_NS:
            return None
        self._waiting = None
        self._answered = waiting.decision
        return Press(waiting.decision, waiting.key, waiting.pressed_ns)
