"""A bus that is closed while one of our threads is inside Zenoh: it waits for it, but not for ever."""

import threading
from collections.abc import Iterator

import pytest

from services.router import free_endpoint
from services.runtime.bus import Received
from services.runtime.zenoh_bus import ZenohBus, ZenohRouter, open_bus

KEY = "held/here"


class Held:
    """A bus in which a thread of ours publishes, held by a subscriber of the same process."""

    def __init__(self, bus: ZenohBus) -> None:
        self.bus = bus
        self.order: list[str] = []
        self.release = threading.Event()
        self._inside = threading.Event()
        bus.subscribe(KEY, self._hold)
        self._threads = [threading.Thread(target=bus.publish, args=(KEY, b""), daemon=True)]
        self._threads[0].start()
        assert self._inside.wait(10)

    def _hold(self, _: Received) -> None:
        self._inside.set()
        self.release.wait(30)
        self.order.append("the publisher is out")

    def close(self) -> threading.Event:
        """Close the bus on another thread; return what is set when it is closed."""
        closed = threading.Event()

        def close() -> None:
            self.bus.close()
            self.order.append("the bus is closed")
            closed.set()

        self._threads.append(threading.Thread(target=close, daemon=True))
        self._threads[-1].start()
        return closed

    def end(self) -> None:
        self.release.set()
        for thread in self._threads:
            thread.join(10)


@pytest.fixture
def held() -> Iterator[Held]:
    endpoint = free_endpoint()
    router = ZenohRouter(endpoint, "")
    made = Held(open_bus(endpoint, 10_000))
    yield made
    made.end()
    router.close()


def test_closing_waits_for_a_thread_that_is_still_inside(held: Held) -> None:
    closed = held.close()
    assert not closed.wait(0.2)
    held.release.set()
    assert closed.wait(10)
    assert held.order == ["the publisher is out", "the bus is closed"]


def test_closing_does_not_wait_for_ever_for_a_thread_that_stays_inside(held: Held) -> None:
    assert held.close().wait(10)
    assert held.order == ["the bus is closed"]
