"""What the command line asks of a learner: create, list, show and control sessions."""

import queue
import time
from collections.abc import Callable
from functools import partial
from typing import TypeVar

from msgspec.structs import replace

from protocol.codec import DecodeError, decode, encode
from protocol.keys import Keys
from protocol.messages import (
    Branch,
    Control,
    CreateSession,
    Done,
    Episode,
    Refusal,
    SessionList,
    SessionQuery,
    SessionReport,
    WindowSpec,
    Wire,
)
from protocol.session_union import union
from services.runtime.bus import Bus, Reply
from services.topology import OPERATOR

M = TypeVar("M", bound=Wire)
A = TypeVar("A", bound=Wire | list[bytes])
TIMEOUT_MS = 2_000
RETRY_S = 0.1


class OperatorError(Exception):
    """The learner refused or does not answer; the text is one line."""


class UnansweredError(OperatorError):
    """Nobody answered for as long as the patience lasts."""


class Operator:
    """Asks the learner and waits for its answer.

    Args: patience_s: how long an absent learner is asked again (it may be restarting); pause: waits so many
    seconds, and raises what ends the asking.
    """

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        patience_s: float = 5.0,
        pause: Callable[[float], None] = time.sleep,
    ) -> None:
        self._bus = bus
        self._keys = keys
        self._patience_s = patience_s
        self._pause = pause

    def create(self, config: CreateSession) -> None:
        """Create a session; the same again is the same session."""
        self._ask(self._keys.learner("create"), config, Done)

    def branch(self, session: str, episode: int, name: str) -> None:
        """Take a session up again from an earlier episode under another name; the same again is the same."""
        self._ask(self._keys.learner("branch"), Branch(session=session, episode=episode, branch=name), Done)

    def sessions(self) -> SessionList:
        """Return a line about every session of the shards in `told`, whose learners replied to the end.

        Where nobody answers any more on the way, `told` is empty: the lines are those heard so far.
        """
        page = self._page_of_list(0, None)
        told = set(page.told)
        latest_first = {one.session: one for one in reversed(page.sessions)}
        while page.older is not None:
            try:
                page = self._page_of_list(page.older, told)
            except UnansweredError:
                page, told = replace(page, older=None), set()
                break
            told.intersection_update(page.told)
            for one in reversed(page.sessions):  # moved on by a newer session, one may come again
                latest_first.setdefault(one.session, one)
        rows = tuple(reversed(latest_first.values()))
        return replace(page, sessions=rows, told=tuple(sorted(told)))

    def show(self, session: str) -> tuple[SessionReport, list[Episode]]:
        """Return a session's report and all its episodes."""
        report = self._page(session, 0)
        episodes = list(report.episodes)
        while report.episodes and len(episodes) < report.summary.episode:
            report = self._page(session, len(episodes))
            episodes += report.episodes
        return report, episodes

    def _page(self, session: str, first: int) -> SessionReport:
        query = SessionQuery(session=session, first_episode=first)
        return self._ask(self._keys.learner("show"), query, SessionReport)

    def control(self, session: str, verb: str, window: WindowSpec | None = None) -> None:
        """Pause, resume or stop a session, or change its window."""
        message = Control(session=session, teacher=OPERATOR, verb=verb, window=window)  # type: ignore[arg-type]
        done = self._ask(self._keys.control(session, OPERATOR), message, Done)
        if not done.ok:
            raise OperatorError(f"session {session}: {done.reason}")

    def _ask(self, key: str, message: Wire, expected: type[M]) -> M:
        def once() -> M | bytes | None:
            replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
            self._bus.ask(key, encode(message), replies.put, TIMEOUT_MS)
            reply = replies.get()
            if reply is None:
                return None
            if not reply.ok:
                return reply.payload
            return _read(partial(decode, reply.payload, expected))

        return self._until_answered(once)

    def _page_of_list(self, leave_out: int, awaited: set[int] | None) -> SessionList:
        """Return a page of the list, asked for again where an awaited shard (None: any) is lacking.

        A reply can be lost on its way: after one question nobody is called absent. What was replied to either
        question counts, and the second is asked without patience.
        """
        heard = self._until_answered(partial(self._lists, leave_out))
        page = _read(partial(union, heard, leave_out))
        if (set(range(page.shards)) if awaited is None else awaited) <= set(page.told):
            return page
        again = self._lists(leave_out)
        return _read(partial(union, [*heard, *again], leave_out)) if isinstance(again, list) else page

    def _lists(self, leave_out: int) -> list[bytes] | bytes | None:
        """Return a page of the list of each learner, encoded, else a refusal, else None."""
        replies: queue.SimpleQueue[tuple[Reply, ...]] = queue.SimpleQueue()
        query = encode(SessionQuery(leave_out=leave_out))
        self._bus.ask_all(self._keys.learner("list"), query, replies.put, TIMEOUT_MS)
        heard = replies.get()
        lists = [reply.payload for reply in heard if reply.ok]
        return lists or next((reply.payload for reply in heard), None)

    def _until_answered(self, once: Callable[[], A | bytes | None]) -> A:
        until = time.monotonic() + self._patience_s
        while True:
            answer = once()
            if answer is not None and not isinstance(answer, bytes):
                return answer
            what = "no learner answers here" if answer is None else _reason_to_wait(answer)
            if time.monotonic() >= until:
                raise UnansweredError(
                    f"{what}: start one with `sfid up` or `sfid learner`, or check --connect and --deployment"
                )
            self._pause(RETRY_S)


def _read(read: Callable[[], M]) -> M:
    try:
        return read()
    except DecodeError as error:
        raise OperatorError(
            f"the learner's answer cannot be read ({error}): is it of this version?"
        ) from None


def _reason_to_wait(payload: bytes) -> str:
    """Return why the learner could not serve the request just now; raise OperatorError when it never will."""
    try:
        refusal = decode(payload, Refusal)
    except DecodeError:
        raise OperatorError("the learner failed on this request: its log says why") from None
    if refusal.code not in {"busy", "not-durable"}:
        raise OperatorError(refusal.reason)
    return refusal.reason
