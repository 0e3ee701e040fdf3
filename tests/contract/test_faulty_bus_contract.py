"""The bus contract on FaultyBus without faults, and what its faults do."""

import queue

import pytest

from services.runtime.bus import Received, Reply, Request
from services.runtime.faults import Faults
from services.runtime.faulty_bus import FaultyBus, FaultyHub
from services.runtime.timeline import Timeline
from tests.contract.bus_contract import BusContract, World

SECOND = 1_000_000_000


class FaultyWorld(World):
    """Buses on one hub of virtual time."""

    def __init__(self, faults: Faults | None = None, seed: int = 0) -> None:
        self.timeline = Timeline()
        self.hub = (
            FaultyHub(self.timeline, seed) if faults is None else FaultyHub(self.timeline, seed, faults)
        )
        self.opened = 0

    def open(self) -> FaultyBus:
        self.opened += 1
        return FaultyBus(self.hub, f"bus-{self.opened}")

    def settle(self) -> None:
        self._run(SECOND // 2)

    def pass_time(self) -> None:
        self._run(60 * SECOND)

    def _run(self, span_ns: int) -> None:
        ended: list[bool] = []
        self.timeline.call_in(span_ns, lambda: ended.append(True))
        while not ended:
            self.timeline.step()


@pytest.fixture
def world() -> World:
    return FaultyWorld()


class TestFaultyBus(BusContract):
    """Every test of the contract."""


def heard(faults: Faults, seed: int) -> list[bytes]:
    world = FaultyWorld(faults, seed)
    one, two = world.open(), world.open()
    inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()
    two.subscribe("a", inbox.put)
    for number in range(200):
        one.publish("a", bytes([number]))
    return [message.payload for message in world.rest(inbox)]


def test_the_same_seed_loses_doubles_and_reorders_the_same_messages_and_another_seed_others() -> None:
    faults = Faults(drop=0.2, duplicate=0.2, reorder=0.5)
    first = heard(faults, 1)
    assert first == heard(faults, 1)
    assert first != heard(faults, 2)
    assert len(set(first)) < 200
    assert len(first) > len(set(first))
    assert first != sorted(first)


def test_a_cut_link_carries_nothing_until_it_is_over() -> None:
    world = FaultyWorld()
    asker, server = world.open(), world.open()
    served: queue.SimpleQueue[Request] = queue.SimpleQueue()
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    server.serve("q", lambda request: request.reply(b"yes"))
    world.hub.cut(asker.name, server.name, 2 * SECOND)
    asker.ask("q", b"1", answers.put, 100)
    assert world.rest(answers) == [None]
    assert served.empty()
    world.pass_time()
    asker.ask("q", b"2", answers.put, 100)
    assert world.rest(answers) == [Reply(b"yes")]


def test_a_killed_bus_hears_nothing_and_its_askers_get_no_answer() -> None:
    world = FaultyWorld()
    asker, server = world.open(), world.open()
    kept: list[Request] = []
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    server.serve("q", kept.append)
    asker.ask("q", b"1", answers.put, 100)
    world.hub.timeline.step()
    server.kill()
    for request in kept:
        request.reply(b"too late")
    assert world.rest(answers) == [None]
