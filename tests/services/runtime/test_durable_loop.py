"""The loop with a journal: nothing that waits is lost, and what waits is bounded."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.codec import decode
from protocol.messages import Done, Refusal
from services.runtime.bus import Reply, Request
from services.runtime.clock import ManualClock
from services.runtime.durable_loop import BATCH_MAX, NOT_DURABLE, DurableLoop, LoopSettings
from services.runtime.journal import JournalFull, Shard
from services.runtime.memory_bus import MemoryBus, MemoryHub

MS = 1_000_000
COMMIT_MS = 500


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock(wall_ns=1_700_000_000_000_000_000)


@pytest.fixture
def loop(tmp_path: Path, clock: ManualClock) -> Iterator[DurableLoop]:
    with Shard.open(tmp_path) as shard:
        yield DurableLoop(shard, clock, LoopSettings("learner", 3, 2, COMMIT_MS))


class FullShard(Shard):
    """A shard whose disk is full until a test makes room."""

    full = True

    def commit(self) -> None:
        if self.full:
            raise JournalFull("the disk is full: free some")
        super().commit()


@pytest.fixture
def failing(tmp_path: Path, clock: ManualClock) -> Iterator[DurableLoop]:
    """A loop whose journal has just failed."""
    with FullShard.open(tmp_path) as shard:
        made = DurableLoop(shard, clock, LoopSettings("learner", 3, 2, COMMIT_MS))
        made.append("s1", "joined", b"ann", made.at_ns())
        clock.advance(COMMIT_MS * MS)
        made.turn(0.0)
        yield made
        shard.full = False


def test_of_a_backlog_longer_than_a_turn_every_item_is_handled_in_order(loop: DurableLoop) -> None:
    handled: list[int] = []
    items = list(range(3 * BATCH_MAX + 7))
    for item in items:
        loop.enqueue(handled.append, item)
    for turn in range(1, 4):
        loop.turn(0.0)
        assert len(handled) == turn * BATCH_MAX
    loop.turn(0.0)
    assert handled == items


def test_more_than_the_inbox_holds_is_refused_as_busy_and_so_is_more_of_one_sender(
    loop: DurableLoop, clock: ManualClock
) -> None:
    bus = MemoryBus(MemoryHub(clock, inline=True))
    bus.serve("*", loop.receiver(lambda request: loop.reply_durably(request, Done(ok=True))))
    replies: dict[str, list[Reply | None]] = {name: [] for name in ("ann", "bob", "cyd")}
    for name in ("ann", "ann", "ann", "bob", "cyd"):
        bus.ask(name, b"", replies[name].append, 60_000)
    reasons = [decode(reply.payload, Refusal).reason for reply in (*replies["ann"], *replies["cyd"]) if reply]
    assert reasons == [
        "too many messages of yours wait: send it again",
        "the learner's inbox is full: send it again",
    ]
    loop.turn(0.0)
    bus.ask("ann", b"", replies["ann"].append, 60_000)
    loop.turn(0.0)
    assert [reply.ok for reply in replies["ann"] if reply] == [False, True, True, True]
    assert [reply.ok for reply in replies["bob"] if reply] == [True]


def test_what_nobody_waits_for_is_durable_after_a_while(
    loop: DurableLoop, clock: ManualClock, tmp_path: Path
) -> None:
    loop.append("s1", "joined", b"ann", loop.at_ns())
    syncs = loop.shard.syncs
    loop.turn(0.0)
    assert loop.shard.syncs == syncs
    clock.advance(COMMIT_MS * MS)
    loop.turn(0.0)
    assert loop.shard.syncs > syncs


def test_a_turn_waits_no_longer_than_until_the_next_timer(loop: DurableLoop, clock: ManualClock) -> None:
    fired: list[str] = []
    assert loop.wait_s(0.2) == 0.2
    loop.call_later(30, fired.append, "due")
    assert loop.wait_s(0.2) == pytest.approx(0.03)
    clock.advance(30 * MS)
    loop.turn(0.0)
    assert fired == ["due"]


def test_whoever_was_refused_while_the_journal_fails_has_their_places_back(
    failing: DurableLoop, clock: ManualClock
) -> None:
    bus = MemoryBus(MemoryHub(clock, inline=True))
    bus.serve("*", failing.receiver(lambda request: failing.reply_durably(request, Done(ok=True))))
    replies: list[Reply | None] = []
    for _ in range(3):
        for _ in range(2):
            bus.ask("ann", b"", replies.append, 60_000)
        failing.turn(0.0)
    codes = [decode(reply.payload, Refusal).code for reply in replies if reply]
    assert codes == ["not-durable"] * 6
    assert failing.turnstile.refused == 0
    assert isinstance(failing.shard, FullShard)
    failing.shard.full = False
    clock.advance(COMMIT_MS * MS)
    failing.turn(0.0)
    for _ in range(2):
        bus.ask("ann", b"", replies.append, 60_000)
    failing.turn(0.0)
    assert [reply.ok for reply in replies[6:] if reply] == [True, True]


def test_what_needs_no_journal_is_answered_while_it_fails(failing: DurableLoop, clock: ManualClock) -> None:
    bus = MemoryBus(MemoryHub(clock, inline=True))
    bus.serve("status", failing.receiver(lambda request: request.reply(b"well"), needs_journal=False))
    bus.serve("answer", failing.receiver(lambda request: request.reply(b"never")))
    replies: list[Reply | None] = []
    for key in ("status", "answer", "status"):
        bus.ask(key, b"", replies.append, 60_000)
    failing.turn(0.0)
    assert [reply and (reply.ok, reply.payload) for reply in replies] == [
        (True, b"well"), (False, NOT_DURABLE), (True, b"well"),
    ]  # fmt: skip


def test_requests_go_before_what_gives_way_and_both_keep_their_order(loop: DurableLoop) -> None:
    handled: list[object] = []
    for number in range(3):
        loop.enqueue_work(handled.append, f"work {number}")
        loop.enqueue(handled.append, number)
    assert loop.waiting == 6
    loop.turn(0.0)
    assert (handled, loop.waiting) == ([0, 1, 2, "work 0", "work 1", "work 2"], 0)


def test_a_burst_of_work_and_timers_is_cut_where_its_time_is_over(
    loop: DurableLoop, clock: ManualClock
) -> None:
    """Each piece takes 2 ms, one of each is done in turns, and after 5 ms none is begun."""
    handled: list[str] = []

    def work(name: str) -> None:
        handled.append(name)
        clock.advance(2 * MS)

    for number in range(4):
        loop.enqueue_work(work, f"work {number}")
        loop.call_later(0, work, f"timer {number}")
    loop.turn(0.0)
    assert handled == ["work 0", "timer 0", "work 1", "timer 1"]
    assert (loop.waiting, loop.wait_s(0.2)) == (2, 0.0)
    loop.enqueue(work, "request")
    loop.turn(0.0)
    assert handled[4:] == ["request", "work 2", "timer 2", "work 3", "timer 3"]


def test_a_loop_with_work_left_does_not_wait_for_a_message(loop: DurableLoop, clock: ManualClock) -> None:
    handled: list[int] = []

    def work(number: int) -> None:
        handled.append(number)
        clock.advance(2 * MS)

    for number in range(4):
        loop.enqueue_work(work, number)
    loop.turn(0.0)
    assert (handled, loop.waiting, loop.wait_s(0.2)) == ([0, 1, 2], 1, 0.0)
    loop.turn(0.0)
    assert (handled, loop.waiting, loop.wait_s(0.2)) == ([0, 1, 2, 3], 0, 0.2)


class SlowShard(Shard):
    """A shard on a disk whose speed a test sets."""

    clock: ManualClock
    takes_ms = 0

    def commit(self) -> None:
        super().commit()
        self.clock.advance(self.takes_ms * MS)


@pytest.mark.parametrize("takes_ms,pieces", [(0, 5), (2, 5), (4, 8), (9, 18), (11, 20), (50, 20)])
def test_work_has_twice_the_time_of_a_commit_but_five_milliseconds_at_least_and_twenty_at_most(
    tmp_path: Path, clock: ManualClock, takes_ms: int, pieces: int
) -> None:
    with SlowShard.open(tmp_path) as shard:
        shard.clock, shard.takes_ms = clock, takes_ms
        loop = DurableLoop(shard, clock, LoopSettings("learner", 3, 2, COMMIT_MS))
        for _ in range(30):
            loop.enqueue_work(clock.advance, MS)
        loop.append("s1", "joined", b"ann", loop.at_ns())
        loop.commit()
        loop.commit()  # of nothing: that says nothing of the disk
        loop.turn(0.0)
        assert loop.waiting == 30 - pieces
        shard.takes_ms = 0


def test_a_slow_batch_of_requests_is_committed_before_the_rest_is_handled(
    loop: DurableLoop, clock: ManualClock
) -> None:
    bus = MemoryBus(MemoryHub(clock, inline=True))
    replies: list[Reply | None] = []

    def slow(request: Request) -> None:
        clock.advance(6 * MS)
        loop.reply_durably(request, Done(ok=True))

    bus.serve("*", loop.receiver(slow))
    for name in ("ann", "bob", "eve"):
        bus.ask(name, b"", replies.append, 60_000)
    loop.turn(0.0)
    assert len(replies) == 2
    loop.turn(0.0)
    assert [reply and reply.ok for reply in replies] == [True] * 3
