"""The bounded queue between the bus and the monitor's worker: the oldest gives way, nobody waits to put."""

import threading
from collections import deque
from dataclasses import dataclass

from services.runtime.bus import Received, Reply, Request

MESSAGES_MAX = 8192
BYTES_MAX = 16 * 1024 * 1024
TAKEN_MAX = 128
"""Messages taken at once: between two takes frames are drawn, and a stop is noticed."""


@dataclass(frozen=True, slots=True)
class Listed:
    """What learners answer to which sessions there are."""

    replies: tuple[Reply, ...]


@dataclass(frozen=True, slots=True)
class Shown:
    """The learner's answer about one session; None when it gave none."""

    session: str
    reply: Reply | None


@dataclass(frozen=True, slots=True)
class Told:
    """A page of a session's journal; None when the learner gave none."""

    session: str
    reply: Reply | None


@dataclass(frozen=True, slots=True)
class Asked:
    """Somebody asks how the monitor does."""

    request: Request


Item = Received | Listed | Shown | Told | Asked


class Inbox:
    """What waits for the worker."""

    def __init__(self) -> None:
        self.dropped = 0
        self._messages: deque[Received] = deque()
        self._replies: list[Listed | Shown | Told | Asked] = []
        self._bytes = 0
        self._wake = threading.Condition()

    def put(self, message: Received) -> None:
        """Add a message of a topic; the oldest are dropped, and counted, when there is no room."""
        with self._wake:
            self._messages.append(message)
            self._bytes += len(message.payload)
            while len(self._messages) > MESSAGES_MAX or self._bytes > BYTES_MAX:
                self._bytes -= len(self._messages.popleft().payload)
                self.dropped += 1
            self._wake.notify()

    def put_reply(self, reply: Listed | Shown | Told | Asked) -> None:
        """Add an answer; never dropped, because the worker asks one thing a session at a time."""
        with self._wake:
            self._replies.append(reply)
            self._wake.notify()

    @property
    def waiting(self) -> int:
        """How many messages and answers wait."""
        return len(self._messages) + len(self._replies)

    def take(self, timeout_s: float) -> list[Item]:
        """Return what waits, answers first and TAKEN_MAX messages at most; nothing after `timeout_s`."""
        with self._wake:
            if not self._messages and not self._replies:
                self._wake.wait(timeout_s)
            items: list[Item] = [*self._replies]
            self._replies.clear()
            for _ in range(min(TAKEN_MAX, len(self._messages))):
                message = self._messages.popleft()
                self._bytes -= len(message.payload)
                items.append(message)
            return items
