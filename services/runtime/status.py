"""How a service does: counted on its loop, told when it is asked."""

import os
from bisect import bisect_left
from collections.abc import Callable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import msgspec

from protocol.codec import encode
from protocol.status_message import COMMIT_BOUNDS_US, ServiceStatus
from services.runtime.bus import Request
from services.runtime.clock import Clock

_MS = 1_000_000


@cache
def program_version() -> str:
    """Return the installed version of the program."""
    try:
        return version("sfid")
    except PackageNotFoundError:
        return "unknown"


class CommitMeter:
    """How often a journal was made durable and how long that took.

    Attributes:
        failure: why it cannot be made durable now; empty when it can.
    """

    def __init__(self, clock: Clock) -> None:
        self.failure = ""
        self._clock = clock
        self._bins = [0] * (len(COMMIT_BOUNDS_US) + 1)
        self._total_us = 0
        self._last_ns: int | None = None

    def took(self, began_ns: int) -> None:
        """Count a commit that began at `began_ns` of the clock and has just ended."""
        now_ns = self._clock.now_ns()
        took_us = (now_ns - began_ns) // 1000
        self._bins[bisect_left(COMMIT_BOUNDS_US, took_us)] += 1
        self._total_us += took_us
        self._last_ns = now_ns

    def facts(self) -> dict[str, Any]:
        """Return what a ServiceStatus says of commits."""
        last_ns = self._last_ns
        return {
            "ready": not self.failure,
            "reason": self.failure,
            "commits": tuple(self._bins),
            "commit_us": self._total_us,
            "last_commit_ms": None if last_ns is None else (self._clock.now_ns() - last_ns) // _MS,
        }


class StatusDesk:
    """Answers requests for a service's status; `reply` is called on the service's loop.

    Args: facts: fields of a ServiceStatus that this service has something to say about.
    """

    def __init__(self, role: str, name: str, clock: Clock, facts: Callable[[], dict[str, Any]]) -> None:
        self._clock = clock
        self._facts = facts
        self._since_ns = clock.now_ns()
        self._fixed = ServiceStatus(
            role=role, name=name, version=program_version(), pid=os.getpid(), uptime_ms=0
        )

    def status(self) -> ServiceStatus:
        """Return how the service does at this moment."""
        uptime_ms = (self._clock.now_ns() - self._since_ns) // _MS
        return msgspec.structs.replace(self._fixed, uptime_ms=uptime_ms, **self._facts())

    def reply(self, request: Request) -> None:
        """Answer a request."""
        request.reply(encode(self.status()))
