"""What the buses have in common: a request that is answered once, and how several replies are one."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol

from services.runtime.bus import Reply
from services.runtime.callback_guard import CallbackGuard

Outcome = Callable[[Reply | None], None]


class AnsweredOnce:
    """A Request (see bus.py) that calls `answer` once; without a reference left it says: no answer."""

    def __init__(self, key: str, payload: bytes, answer: Outcome) -> None:
        self.key = key
        self.payload = payload
        # A list, because pop() hands it to one thread only, without a lock.
        self._unanswered = [answer]

    def __del__(self) -> None:
        self._answer(None)

    def reply(self, payload: bytes) -> None:
        """See Request."""
        self._answer(Reply(bytes(payload), ok=True))

    def reply_error(self, payload: bytes) -> None:
        """See Request."""
        self._answer(Reply(bytes(payload), ok=False))

    def _answer(self, outcome: Reply | None) -> None:
        try:
            answer = self._unanswered.pop()
        except IndexError:
            return
        answer(outcome)


def first_of(count: int, receive: Outcome) -> Outcome:
    """Return what takes the outcomes of `count` servers: the first reply, else None at the end."""
    if count <= 1:
        return receive
    left, told = [count], [False]

    def take(outcome: Reply | None) -> None:
        left[0] -= 1
        if not told[0] and (outcome is not None or not left[0]):
            told[0] = True
            receive(outcome)

    return take


def all_of(count: int, receive: Callable[[tuple[Reply, ...]], None]) -> Outcome:
    """Return what takes the outcomes of `count` servers (one None where there are none): all at the end."""
    left, replies = [max(1, count)], list[Reply]()

    def take(outcome: Reply | None) -> None:
        left[0] -= 1
        if outcome is not None:
            replies.append(outcome)
        if not left[0]:
            receive(tuple(replies))

    return take


class AsksServers(ABC):
    """The asking of a bus (Requests, see bus.py) that knows how many servers a question goes to."""

    def ask(self, key: str, payload: bytes, receive: Outcome, timeout_ms: int) -> None:
        """See Requests."""
        self._ask(key, payload, lambda count: first_of(count, receive), timeout_ms)

    def ask_all(
        self, key: str, payload: bytes, receive: Callable[[tuple[Reply, ...]], None], timeout_ms: int
    ) -> None:
        """See Requests."""
        self._ask(key, payload, lambda count: all_of(count, receive), timeout_ms)

    @abstractmethod
    def _ask(self, key: str, payload: bytes, outcome_of: Callable[[int], Outcome], timeout_ms: int) -> None:
        """Ask every server of the key, and give what `outcome_of` their number returns each outcome."""


class OpenAsk(Protocol):
    """One question in flight, of whom nobody knows how many will reply."""

    def took(self, reply: Reply | None) -> None:
        """Take a reply, or word that the time is up."""

    def end(self) -> None:
        """No more replies will come."""


class FirstReply:
    """An OpenAsk that hands on the first outcome and forgets the rest."""

    def __init__(self, guard: CallbackGuard, receive: Outcome, forget: Callable[[OpenAsk], None]) -> None:
        self._guard = guard
        self._receive = [receive]
        self._forget = forget

    def took(self, reply: Reply | None) -> None:
        """See OpenAsk."""
        try:
            receive = self._receive.pop()
        except IndexError:
            return
        self._forget(self)
        self._guard.call("ask", receive, reply)

    def end(self) -> None:
        """See OpenAsk."""
        self.took(None)


class EveryReply:
    """An OpenAsk that hands on all replies at the end."""

    def __init__(
        self,
        guard: CallbackGuard,
        receive: Callable[[tuple[Reply, ...]], None],
        forget: Callable[[OpenAsk], None],
    ) -> None:
        self._guard = guard
        self._receive = [receive]
        self._forget = forget
        self._replies: list[Reply] = []

    def took(self, reply: Reply | None) -> None:
        """See OpenAsk."""
        if reply is not None:
            self._replies.append(reply)

    def end(self) -> None:
        """See OpenAsk."""
        try:
            receive = self._receive.pop()
        except IndexError:
            return
        self._forget(self)
        self._guard.call("ask", receive, tuple(self._replies))
