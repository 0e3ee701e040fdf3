"""Token buckets and counters: what keeps one visitor from being a burden on the others."""

from collections import Counter
from dataclasses import dataclass
from enum import Enum


class Reason(Enum):
    """Why something from a browser was refused: a closed list, for counters."""

    HOST = "host"
    """The request named another host: a name that was pointed at us."""
    ORIGIN = "origin"
    PATH = "path"
    CROWDED = "connections"
    """More connections than allowed, in all or from one address."""
    NO_HELLO = "hello-timeout"
    TOO_LARGE = "frame-too-large"
    BINARY = "frame-binary"
    MALFORMED = "frame-malformed"
    FLOOD = "flood"
    FLOODER = "flooder-closed"
    HELLOS = "hello-rate"
    OPEN_ANSWERS = "answers-open"
    FULL = "invitation-full"
    PEOPLE = "people"
    FLOW = "flow"
    FAULT = "fault"
    """Our own mistake; the log has it."""
    FIELDS = "fields"
    REPLAY = "replay"
    """An answer that had its acknowledgement came again: it gets the same one, and nobody else is asked."""
    NOT_TEACHING = "not-teaching"
    SLOW_READER = "slow-reader"
    IDLE = "idle"
    MALFORMED_TOKEN = "malformed-token"  # noqa: S105 - a name for counters
    FORGED_TOKEN = "forged-token"  # noqa: S105 - a name for counters
    EXPIRED_TOKEN = "expired-token"  # noqa: S105 - a name for counters
    REVOKED_TOKEN = "revoked-token"  # noqa: S105 - a name for counters


class Counters:
    """How much was done, and refused for which reason."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.done: Counter[str] = Counter()

    def refuse(self, reason: Reason) -> None:
        """Count one refusal."""
        self.refused[reason.value] += 1


@dataclass(slots=True)
class Bucket:
    """A token bucket: `rate_per_s` on average, `burst` at once."""

    rate_per_s: float
    burst: float
    level: float = -1.0
    at_s: float = 0.0

    def take(self, now_s: float) -> bool:
        """Take one if there is one."""
        if self.level < 0:
            self.level = self.burst
        else:
            self.level = min(self.burst, self.level + (now_s - self.at_s) * self.rate_per_s)
        self.at_s = now_s
        if self.level < 1.0:
            return False
        self.level -= 1.0
        return True
