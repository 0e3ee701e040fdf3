"""The loop with a journal: nothing that waits is lost, and what waits is bounded."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.codec import decode
from protocol.messages import Done, Refusal
from services.runtime.bus import Reply
from services.runtime.clock import ManualClock
from services.runtime.durable_loop import BATCH_MAX, DurableLoop, LoopSettings
from services.runtime.journal import Shard
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
