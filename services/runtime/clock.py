"""Time as an argument: the clock of the system, and one that a test moves by hand."""

import time
from typing import Protocol


class Clock(Protocol):
    """Two times: one to measure spans with, one to show to people."""

    def now_ns(self) -> int:
        """Nanoseconds on a clock that never goes back; only differences mean something."""

    def wall_ns(self) -> int:
        """Nanoseconds since 1970-01-01 UTC; it may jump when the system's time is set."""


class SystemClock:
    """The clock of this machine."""

    def now_ns(self) -> int:
        """See Clock."""
        return time.monotonic_ns()

    def wall_ns(self) -> int:
        """See Clock."""
        return time.time_ns()


class ManualClock:
    """A clock that stands still until it is advanced."""

    def __init__(self, now_ns: int = 0, wall_ns: int = 0) -> None:
        self._now_ns = now_ns
        self._wall_ns = wall_ns

    def now_ns(self) -> int:
        """See Clock."""
        return self._now_ns

    def wall_ns(self) -> int:
        """See Clock."""
        return self._wall_ns

    def advance(self, span_ns: int) -> None:
        """Move both times forward by `span_ns` (>= 0); ValueError when it is negative."""
        if span_ns < 0:
            message = f"span_ns = {span_ns}: a clock moves forward only"
            raise ValueError(message)
        self._now_ns += span_ns
        self._wall_ns += span_ns
