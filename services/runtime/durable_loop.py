"""A loop over one inbox with timers and a journal: what waits for durability goes out after the commit."""

import heapq
import itertools
import logging
import queue
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from protocol.codec import encode
from protocol.messages import Refusal, Wire
from services.runtime.bus import Request
from services.runtime.clock import Clock
from services.runtime.journal import JournalError, JournalFenced, Shard
from services.runtime.status import CommitMeter
from services.runtime.turnstile import Turnstile

BATCH_MAX = 256
"""Messages handled before a commit: bounds how long the first of them waits for its acknowledgement."""
BATCH_NS = 10_000_000
"""So does the time of handling them."""
WORK_NS, WORK_NS_MAX = 5_000_000, 20_000_000
"""Then what nobody waits for has its turn: 5 ms, or, where the disk is slow, twice as long as a commit takes,
so that it is not the disk that most of the time goes to."""
COMMIT_RETRY_MS = 500
NOT_DURABLE = encode(Refusal(code="not-durable", reason="the journal cannot be written: send it again"))


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Whose loop it is, and its bounds."""

    service: str
    """Name of the service, in its log and its refusals."""
    inbox_max: int
    """Messages that wait at most; more are refused as busy."""
    waiting_max: int
    """Messages of one sender and kind that wait at most: who floods waits behind themselves."""
    commit_every_ms: int
    """What nobody waits for is durable after so long."""


class _Item(NamedTuple):
    """One thing to do on the loop's thread."""

    handle: Callable[[Any], None]
    argument: Any
    request: Request | None = None
    """The request that this is, if it is one: it can be refused while the journal fails."""
    needs_journal: bool = True
    gives_way: bool = False


class DurableLoop:
    """Handlers run on the thread of `turn`, one after another; `enqueue` and `receiver` serve any thread."""

    def __init__(self, shard: Shard, clock: Clock, settings: LoopSettings) -> None:
        self.shard = shard
        self._clock = clock
        self._settings = settings
        self._log = logging.getLogger(f"sfid.{settings.service}")
        self._commit_every_ns = settings.commit_every_ms * 1_000_000
        # A steady clock that reads as wall time: it never jumps within this process, and rows are dated.
        self._offset_ns = clock.wall_ns() - clock.now_ns()
        self._inbox: queue.SimpleQueue[_Item] = queue.SimpleQueue()
        self._timers: list[tuple[int, int, Callable[[Any], None], Any]] = []
        self._timer_numbers = itertools.count()
        self._unsent: list[tuple[Request, bytes]] = []
        self._after_commit: list[Callable[[], None]] = []
        self._uncommitted_since_ns: int | None = None
        self._failing = False
        self._retry_at_ns = 0
        """When a failing journal is tried again; until then timers and all but requests wait."""
        self._held: list[_Item] = []
        self._work: deque[_Item] = deque()
        """What has been taken from the inbox and gives way to people."""
        self._work_ns = WORK_NS
        self.commits = CommitMeter(clock)
        self.turnstile = Turnstile(settings.waiting_max)

    @property
    def waiting(self) -> int:
        """How many messages wait for the loop."""
        return self._inbox.qsize() + len(self._work) + len(self._held)

    # ------------------------------------------------------------ what handlers use

    def at_ns(self) -> int:
        """Return the time of events: steady within the process, close to wall time."""
        return self._clock.now_ns() + self._offset_ns

    def append(
        self, session: str, kind: str, body: bytes, at_ns: int, unique: bytes | None = None,
        person: str | None = None,
    ) -> int:  # fmt: skip
        """Append a row to the open group and return its number; it is durable after the next commit."""
        if self._uncommitted_since_ns is None:
            self._uncommitted_since_ns = at_ns
        return self.shard.append(session, kind, body, at_ns=at_ns, unique=unique, person=person)

    def reply_durably(self, request: Request, reply: Wire) -> None:
        """Reply after the next commit, and only if it succeeds."""
        self._unsent.append((request, encode(reply)))

    def after_commit(self, action: Callable[[], None]) -> None:
        """Do this on the loop's thread once everything appended so far is durable, however long it takes."""
        self._after_commit.append(action)

    def call_at(self, at_ns: int, handle: Callable[[Any], None], argument: Any) -> None:  # noqa: ANN401 - the handler's
        """Call `handle(argument)` on the loop's thread at a time of `at_ns`'s scale, or soon after."""
        heapq.heappush(self._timers, (at_ns, next(self._timer_numbers), handle, argument))

    def call_later(self, delay_ms: int, handle: Callable[[Any], None], argument: Any) -> None:  # noqa: ANN401
        """Call `handle(argument)` on the loop's thread, about `delay_ms` from now."""
        self.call_at(self.at_ns() + delay_ms * 1_000_000, handle, argument)

    # ------------------------------------------------------------ on any thread

    def enqueue(self, handle: Callable[[Any], None], argument: Any) -> None:  # noqa: ANN401
        """Have `handle(argument)` called on the loop's thread."""
        self._inbox.put(_Item(handle, argument))

    def enqueue_work(self, handle: Callable[[Any], None], argument: Any) -> None:  # noqa: ANN401
        """Have `handle(argument)` called on the loop's thread, in the order of such calls; requests go first.

        As do timers, it gives way: a hundred sessions whose windows close together hold no teacher up.
        """
        self._inbox.put(_Item(handle, argument, gives_way=True))

    def receiver(
        self, handle: Callable[[Request], None], *, needs_journal: bool = True
    ) -> Callable[[Request], None]:
        """Return a bus callback that has requests handled, and refuses them when too much waits.

        Args: needs_journal: requests are refused while the journal fails, because they may change something.
        """
        full = _busy(f"the {self._settings.service}'s inbox is full: send it again")
        too_many = _busy("too many messages of yours wait: send it again")

        def receive(request: Request) -> None:
            if self._inbox.qsize() >= self._settings.inbox_max:
                request.reply_error(full)
            elif self.turnstile.enter(request.key):
                self._inbox.put(_Item(handle, request, request, needs_journal))
            else:
                request.reply_error(too_many)

        return receive

    # ------------------------------------------------------------ the loop

    def run(self, stop: threading.Event) -> None:
        """Turn until `stop` is set."""
        while not stop.is_set():
            self.turn(0.2)
        self.turn(0.0)

    def turn(self, timeout_s: float) -> None:
        """Handle what waits, then work and due timers, commit, send what waited for it; within bounds."""
        try:
            item = self._inbox.get(timeout=self.wait_s(timeout_s)) if timeout_s else self._inbox.get_nowait()
            until_ns = self._clock.now_ns() + BATCH_NS
            self._take(item)
            for _ in range(BATCH_MAX - 1):
                if self._clock.now_ns() >= until_ns:
                    break
                self._take(self._inbox.get_nowait())
        except queue.Empty:
            pass
        self._do_work()
        if self._commit_due():
            self.commit()

    def _take(self, item: _Item) -> None:
        if item.gives_way:
            self._work.append(item)
        else:
            self._handle(item)

    def _do_work(self) -> None:
        """Do what gives way and fire due timers, in turns, for a while."""
        until_ns = self._clock.now_ns() + self._work_ns
        busy = True
        while busy:
            busy = False
            if self._work:
                self._handle(self._work.popleft())
                busy = True
            if self._timers and not self._failing and self._timers[0][0] <= self.at_ns():
                _, _, handle, argument = heapq.heappop(self._timers)
                handle(argument)
                busy = True
            busy = busy and self._clock.now_ns() < until_ns

    def commit(self) -> None:
        """Make the group durable, then send what waited for it; a failing journal refuses and tries again."""
        unsent, self._unsent = self._unsent, []
        syncs, began_ns = self.shard.syncs, self._clock.now_ns()
        try:
            self.shard.commit()
        except JournalError as error:
            self._failed(error, [request for request, _ in unsent])
            return
        if self.shard.syncs != syncs:
            self.commits.took(began_ns)
            self._work_ns = min(max(WORK_NS, 2 * (self._clock.now_ns() - began_ns)), WORK_NS_MAX)
        self._uncommitted_since_ns = None
        for request, payload in unsent:
            request.reply(payload)
        actions, self._after_commit = self._after_commit, []
        for action in actions:
            action()
        if self._failing:
            self._log.warning("the journal can be written again: teaching goes on")
            self._failing = False
            self.commits.failure = ""
            held, self._held = self._held, []
            for item in held:
                self._handle(item)

    def _handle(self, item: _Item) -> None:
        if item.request is not None:
            self.turnstile.leave(item.request.key)
        if not (self._failing and item.needs_journal):
            item.handle(item.argument)
        elif item.request is not None:
            item.request.reply_error(NOT_DURABLE)
        else:  # nothing takes effect while it cannot be made durable
            self._held.append(item)

    def _failed(self, error: JournalError, waiting: list[Request]) -> None:
        if isinstance(error, JournalFenced):
            raise error
        if not self._failing:
            self._log.error("nothing is acknowledged until the journal can be written: %s", error)
        self._failing = True
        self.commits.failure = f"nothing can be saved: {error}"[:512]
        refusal = encode(Refusal(code="not-durable", reason=f"not saved: {error}"[:512]))
        for request in waiting:
            request.reply_error(refusal)
        self._retry_at_ns = self.at_ns() + COMMIT_RETRY_MS * 1_000_000

    def _commit_due(self) -> bool:
        if self._failing:
            return self.at_ns() >= self._retry_at_ns
        since_ns = self._uncommitted_since_ns
        overdue = since_ns is not None and self.at_ns() - since_ns >= self._commit_every_ns
        return bool(self._unsent or self._after_commit) or overdue

    def wait_s(self, timeout_s: float) -> float:
        """Return how long `turn` may wait for a message before a timer is due: `timeout_s` at most."""
        if self._work:
            return 0.0
        due_ns = self._retry_at_ns if self._failing else self._timers[0][0] if self._timers else None
        if due_ns is None:
            return timeout_s
        return min(timeout_s, max(0.0, (due_ns - self.at_ns()) / 1e9))


def _busy(reason: str) -> bytes:
    return encode(Refusal(code="busy", reason=reason))
