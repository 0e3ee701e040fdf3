"""A bus for clients that live in somebody else's loop."""

from protocol.keys import Keys
from services.client import Client, Opened, Welcomed
from services.client.one_loop import LoopBus
from services.outbox import Outbox
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.teachers.fake_learner import FakeLearner


class Loop:
    """A fake learner, and a client whose loop is this test."""

    def __init__(self) -> None:
        self.hub = MemoryHub(inline=True)
        self.learner = FakeLearner(MemoryBus(self.hub))
        self.bus = MemoryBus(self.hub)
        self.woken = 0
        self.line = LoopBus(self.bus, self.wake)

    def wake(self) -> None:
        self.woken += 1

    def client(self) -> Client:
        made = Client(self.line, Keys("local"), "s1", "ann", outbox=Outbox(), clock=ManualClock())
        made.__enter__()
        return made


def updates(client: Client) -> list[str]:
    found = []
    while (update := client.next(0)) is not None:
        found.append(type(update).__name__)
    return found


def test_the_loop_is_woken_by_everything_that_comes() -> None:
    loop = Loop()
    client = loop.client()
    joined = loop.woken
    assert joined > 0
    assert {Welcomed.__name__, Opened.__name__} <= set(updates(client))
    loop.learner.go_on(decision=1)
    assert (loop.woken, updates(client)) == (joined + 1, ["Opened"])


def test_the_next_client_uses_the_subscriptions_of_the_last() -> None:
    loop = Loop()
    for _ in range(5):
        client = loop.client()
        updates(client)
        loop.learner.go_on(decision=loop.learner.decision.decision + 1)
        assert updates(client) == ["Opened"]
        client.close()
        loop.line.release()
    assert len(loop.bus.subscriptions) == 2  # decisions and measures, once each


def test_a_client_that_is_gone_gets_nothing_more() -> None:
    loop = Loop()
    client = loop.client()
    client.close()
    loop.line.release()
    for _ in range(100):
        loop.learner.go_on(decision=loop.learner.decision.decision + 1)
    assert client.next(0) is None
    assert client.dropped == 0


def test_closing_the_line_leaves_the_bus_to_whoever_opened_it() -> None:
    loop = Loop()
    loop.line.close()
    assert (loop.line.connected(), loop.bus.connected()) == (True, True)
    assert loop.line.callback_errors == 0
