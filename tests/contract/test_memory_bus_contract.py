"""The bus contract on MemoryBus, and what the fake adds to it."""

import queue
import threading

import pytest

from services.runtime.bus import Presence, Received, Reply, Request
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.contract.bus_contract import BusContract, World


class MemoryWorld(World):
    """Buses on one hub."""

    def __init__(self, *, inline: bool) -> None:
        self.clock = ManualClock()
        self.hub = MemoryHub(self.clock, inline=inline)

    def open(self) -> MemoryBus:
        return MemoryBus(self.hub)

    def settle(self) -> None:
        self.hub.deliver_all()

    def pass_time(self) -> None:
        self.clock.advance(60_000_000_000)
        assert self.hub.expire_requests() == 1


@pytest.fixture(params=[False, True], ids=["queued", "inline"])
def world(request: pytest.FixtureRequest) -> World:
    return MemoryWorld(inline=request.param)


class TestMemoryBus(BusContract):
    """Every test of the contract."""


def test_nothing_is_delivered_before_deliver_all_and_then_all_in_order() -> None:
    hub = MemoryHub()
    one, two = MemoryBus(hub), MemoryBus(hub)
    inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()
    one.subscribe("**", inbox.put)
    one.publish("a", b"1")
    two.publish("b", b"2")
    one.publish("c", b"3")
    assert inbox.empty()
    assert hub.deliver_all() == 3
    heard = [inbox.get_nowait() for _ in range(3)]
    assert heard == [Received("a", b"1"), Received("b", b"2"), Received("c", b"3")]
    assert hub.deliver_all() == 0


def test_an_inline_hub_delivers_before_the_sending_call_returns_also_what_callbacks_send() -> None:
    hub = MemoryHub(inline=True)
    one, two = MemoryBus(hub), MemoryBus(hub)
    heard: list[str] = []

    def send_on(message: Received) -> None:
        heard.append("first, begin")
        two.publish("second", message.payload)
        heard.append("first, end")

    two.subscribe("first", send_on)
    one.subscribe("second", lambda _: heard.append("second"))
    one.publish("first", b"")
    assert heard == ["first, begin", "first, end", "second"]


def test_an_ask_expires_when_its_own_time_is_up() -> None:
    clock = ManualClock()
    hub = MemoryHub(clock, inline=True)
    asker, server = MemoryBus(hub), MemoryBus(hub)
    answers: queue.SimpleQueue[tuple[str, Reply | None]] = queue.SimpleQueue()
    requests: list[Request] = []
    server.serve("rpc", requests.append)
    asker.ask("rpc", b"", lambda reply: answers.put(("short", reply)), timeout_ms=100)
    asker.ask("rpc", b"", lambda reply: answers.put(("long", reply)), timeout_ms=101)
    clock.advance(99_999_999)
    assert hub.expire_requests() == 0
    clock.advance(1)
    assert hub.expire_requests() == 1
    assert answers.get_nowait() == ("short", None)
    requests[1].reply(b"in time")
    assert answers.get_nowait() == ("long", Reply(b"in time"))
    assert hub.expire_requests() == 0


def test_without_a_clock_every_open_ask_expires_at_once() -> None:
    hub = MemoryHub(inline=True)
    bus = MemoryBus(hub)
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    requests: list[Request] = []
    bus.serve("rpc", requests.append)
    bus.ask("rpc", b"", answers.put, timeout_ms=1_000_000)
    assert hub.expire_requests() == 1
    assert answers.get_nowait() is None


def test_a_bus_that_is_cut_off_loses_what_is_sent_meanwhile_and_comes_back_with_all_it_declared() -> None:
    hub = MemoryHub(inline=True)
    cut, other = MemoryBus(hub), MemoryBus(hub)
    events: list[object] = []
    requests: list[Request] = []
    cut.subscribe("topic", events.append)
    cut.on_connection(events.append)
    cut.watch("live/*", events.append)
    other.serve("rpc", requests.append)
    other.announce("live/other")
    cut.ask("rpc", b"", events.append, timeout_ms=1000)
    cut.set_online(online=False)
    other.publish("topic", b"lost")
    cut.ask("rpc", b"", events.append, timeout_ms=1000)
    cut.set_online(online=True)
    other.publish("topic", b"heard")
    assert events == [
        True,
        Presence("live/other", present=True),
        None,
        Presence("live/other", present=False),
        False,
        None,
        Presence("live/other", present=True),
        True,
        Received("topic", b"heard"),
    ]


def test_several_threads_on_an_inline_hub_lose_nothing() -> None:
    hub = MemoryHub(inline=True)
    inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()
    MemoryBus(hub).subscribe("topic/*", inbox.put)
    start = threading.Barrier(4)

    def publish_many(bus: MemoryBus, key: str) -> None:
        start.wait()
        for number in range(200):
            bus.publish(key, str(number).encode())

    threads = [threading.Thread(target=publish_many, args=(MemoryBus(hub), f"topic/{i}")) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    heard = [inbox.get_nowait() for _ in range(800)]
    numbers = {f"topic/{i}": [int(one.payload) for one in heard if one.key == f"topic/{i}"] for i in range(4)}
    assert numbers == {f"topic/{i}": list(range(200)) for i in range(4)}
