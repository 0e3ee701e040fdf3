"""The bus contract on ZenohBus through a real router process, and what only real processes can show."""

import queue
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from services.router import free_endpoint
from services.runtime.bus import BusError, Presence, Received, Reply, Request
from services.runtime.known_keys import USES_TO_KNOW
from services.runtime.zenoh_bus import ZenohBus, open_bus
from services.runtime.zenoh_config import LinkLimits
from tests.contract.bus_contract import DEADLINE_S, LONG_MS, BusContract, World
from tests.contract.router_process import router_process

pytestmark = pytest.mark.real
OPEN_MS = 5000


class ZenohWorld(World):
    """Buses on one router."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._buses: list[ZenohBus] = []

    def open(self) -> ZenohBus:
        bus = open_bus(self._endpoint, OPEN_MS)
        # Outside the keys that the contract uses, and `@` keeps it out of their wildcards.
        bus.serve(f"@settle/{len(self._buses)}", lambda request: request.reply(b""))
        self._buses.append(bus)
        return bus

    def settle(self) -> None:
        # What a session sends arrives in order: once B has answered A, B has all that A sent before.
        for asker in self._buses:
            for number, server in enumerate(self._buses):
                if asker is not server and asker.connected() and server.connected():
                    reach(asker, f"@settle/{number}")

    def pass_time(self) -> None:
        """Time passes by itself."""

    def close(self) -> None:
        for bus in self._buses:
            bus.close()


def asked(asker: ZenohBus, key: str, payload: bytes) -> Reply | None:
    """Ask once."""
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    asker.ask(key, payload, answers.put, LONG_MS)
    return answers.get(timeout=DEADLINE_S)


def reach(asker: ZenohBus, key: str) -> Reply:
    """Ask until there is an answer: a server's declaration may still be on its way."""
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    deadline_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline_s:
        asker.ask(key, b"", answers.put, timeout_ms=1000)
        reply = answers.get(timeout=DEADLINE_S)
        if reply is not None:
            return reply
    raise AssertionError(f"nobody answers {key}")


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    endpoint = free_endpoint()
    with router_process(endpoint):
        yield endpoint


@pytest.fixture
def world(endpoint: str) -> Iterator[World]:
    world = ZenohWorld(endpoint)
    yield world
    world.close()


class TestZenohBus(BusContract):
    """Every test of the contract."""


_ANNOUNCE = """
import sys, threading
from services.runtime.zenoh_bus import open_bus
bus = open_bus(sys.argv[1], 5000)
held = []
bus.serve("rpc", held.append)
bus.announce("live")
print("ready", flush=True)
threading.Event().wait()
"""


def start(program: str, endpoint: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", program, endpoint],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
    )


def test_a_killed_process_is_gone_at_once_and_its_requests_have_no_answer(
    world: World, endpoint: str
) -> None:
    watcher = world.open()
    inbox: queue.SimpleQueue[Presence] = queue.SimpleQueue()
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    watcher.watch("live", inbox.put)
    with start(_ANNOUNCE, endpoint) as process:
        assert inbox.get(timeout=DEADLINE_S) == Presence("live", present=True)
        watcher.ask("rpc", b"", answers.put, LONG_MS)
        process.send_signal(signal.SIGKILL)
        # Well below the lease of 2.5 s: the socket tells, not the silence.
        assert inbox.get(timeout=1.0) == Presence("live", present=False)
        assert answers.get(timeout=1.0) is None
        process.communicate()


def test_a_stopped_process_is_gone_after_its_lease(world: World, endpoint: str) -> None:
    watcher = world.open()
    inbox: queue.SimpleQueue[Presence] = queue.SimpleQueue()
    watcher.watch("live", inbox.put)
    with start(_ANNOUNCE, endpoint) as process:
        assert inbox.get(timeout=DEADLINE_S) == Presence("live", present=True)
        process.send_signal(signal.SIGSTOP)
        assert inbox.get(timeout=DEADLINE_S) == Presence("live", present=False)
        process.send_signal(signal.SIGCONT)
        assert inbox.get(timeout=DEADLINE_S) == Presence("live", present=True)
        process.kill()
        process.communicate()


def test_a_restarted_router_finds_everything_declared_again() -> None:
    endpoint = free_endpoint()
    states: queue.SimpleQueue[bool] = queue.SimpleQueue()
    messages: queue.SimpleQueue[Received] = queue.SimpleQueue()
    presences: queue.SimpleQueue[Presence] = queue.SimpleQueue()
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    held: queue.SimpleQueue[Request] = queue.SimpleQueue()
    with router_process(endpoint):
        one, two = open_bus(endpoint, OPEN_MS), open_bus(endpoint, OPEN_MS)
        one.serve("rpc", lambda request: request.reply(b"here"))
        one.serve("slow", held.put)
        one.subscribe("topic", messages.put)
        one.announce("live")
        two.watch("live", presences.put)
        two.on_connection(states.put)
        assert reach(two, "rpc") == Reply(b"here")
        assert presences.get(timeout=DEADLINE_S) == Presence("live", present=True)
        two.ask("slow", b"", answers.put, LONG_MS)
        held.get(timeout=DEADLINE_S)
    try:
        # The router is killed here.
        assert answers.get(timeout=1.0) is None
        assert presences.get(timeout=1.0) == Presence("live", present=False)
        assert [states.get(timeout=1.0), states.get(timeout=1.0)] == [True, False]
        two.publish("topic", b"lost")
        two.ask("rpc", b"", answers.put, LONG_MS)
        assert answers.get(timeout=1.0) is None
        with router_process(endpoint):
            assert states.get(timeout=DEADLINE_S) is True
            assert presences.get(timeout=DEADLINE_S) == Presence("live", present=True)
            assert reach(two, "rpc") == Reply(b"here")
            two.publish("topic", b"heard")
            assert messages.get(timeout=DEADLINE_S) == Received("topic", b"heard")
    finally:
        one.close()
        two.close()


def test_what_is_said_often_is_heard_in_order_also_after_the_router_was_restarted() -> None:
    """After some uses a key is declared, and goes as a number from then on."""
    endpoint = free_endpoint()
    messages: queue.SimpleQueue[Received] = queue.SimpleQueue()
    said = [b"%d" % number for number in range(3 * USES_TO_KNOW)]
    with router_process(endpoint):
        one, two = open_bus(endpoint, OPEN_MS), open_bus(endpoint, OPEN_MS)
        one.serve("rpc/*", lambda request: request.reply(request.key.encode() + request.payload))
        one.subscribe("topic/*", messages.put)
        assert reach(two, "rpc/b") == Reply(b"rpc/b")
        for payload in said:
            two.publish("topic/a", payload)
            assert asked(two, "rpc/a", payload) == Reply(b"rpc/a" + payload)
        heard = [messages.get(timeout=DEADLINE_S) for _ in said]
        assert heard == [Received("topic/a", payload) for payload in said]
    try:
        with router_process(endpoint):
            assert reach(two, "rpc/a") == Reply(b"rpc/a")
            two.publish("topic/a", b"again")
            assert messages.get(timeout=DEADLINE_S) == Received("topic/a", b"again")
    finally:
        one.close()
        two.close()


def test_a_router_that_hangs_holds_up_neither_asks_nor_closing() -> None:
    endpoint = free_endpoint()
    limits = LinkLimits(lease_ms=500)
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    states: queue.SimpleQueue[bool] = queue.SimpleQueue()
    with router_process(endpoint) as router:
        one, two = open_bus(endpoint, OPEN_MS, limits), open_bus(endpoint, OPEN_MS, limits)
        router.send_signal(signal.SIGSTOP)
        one.ask("rpc", b"", answers.put, timeout_ms=100)
        assert answers.get(timeout=1.0) is None
        begin_s = time.monotonic()
        one.close()
        two.on_connection(states.put)
        assert [states.get(timeout=DEADLINE_S), states.get(timeout=DEADLINE_S)] == [True, False]
        two.close()
        with pytest.raises(BusError, match="no router at"):
            open_bus(endpoint, 1)
        assert time.monotonic() - begin_s < 10


def test_a_burst_of_asks_is_answered_completely(world: World) -> None:
    asker, server = world.open(), world.open()
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    server.serve("rpc", lambda request: request.reply(request.payload))
    world.settle()
    sent = [str(number).encode() for number in range(500)]
    for payload in sent:
        asker.ask("rpc", payload, answers.put, LONG_MS)
    replies = [answers.get(timeout=DEADLINE_S) for _ in sent]
    assert sorted(reply.payload for reply in replies if reply is not None) == sorted(sent)


def test_the_largest_payload_passes_and_a_larger_one_does_not(world: World) -> None:
    publisher, subscriber = world.open(), world.open()
    inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()
    subscriber.subscribe("topic", inbox.put)
    world.settle()
    bytes_max = LinkLimits().message_bytes_max
    for size in (bytes_max + 1, bytes_max, 1):
        publisher.publish("topic", bytes(size))
    assert [len(world.next(inbox).payload) for _ in range(2)] == [bytes_max, 1]
    assert world.rest(inbox) == []


@pytest.mark.parametrize(
    "wrong", ["localhost:7447", "udp/127.0.0.1:7447", "tcp/127.0.0.1", "tcp/:1", "tcp/h:99999"]
)
def test_a_malformed_endpoint_is_refused_at_once_with_an_example(wrong: str) -> None:
    with pytest.raises(BusError, match=r"is not of the form tcp/HOST:PORT, as in tcp/127\.0\.0\.1:7447"):
        open_bus(wrong, 60_000)


def test_without_a_router_opening_says_where_and_what_to_do() -> None:
    endpoint = free_endpoint()
    with pytest.raises(BusError) as caught:
        open_bus(endpoint, 250)
    assert str(caught.value) == f"no router at {endpoint}: start one with `sfid router` or pass --connect"


def test_opening_waits_for_a_router_that_comes_later() -> None:
    endpoint = free_endpoint()
    opened: queue.SimpleQueue[bool] = queue.SimpleQueue()
    program = """
import sys
from services.runtime.zenoh_bus import open_bus
print("trying", flush=True)
bus = open_bus(sys.argv[1], 20000)
print(bus.connected(), flush=True)
"""
    with start(program, endpoint) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "trying\n"
        with router_process(endpoint):
            opened.put(process.stdout.readline() == "True\n")
            assert process.wait(DEADLINE_S) == 0
    assert opened.get() is True


_UNDER_TRAFFIC = """
import signal, sys, threading
from services.runtime.zenoh_bus import open_bus
bus = open_bus(sys.argv[1], 5000)
other = open_bus(sys.argv[1], 5000)
busy = threading.Event()
for one in (bus, other):
    one.subscribe("topic/*", lambda _: busy.set())
    one.serve("rpc/*", lambda request: request.reply(b""))
    one.watch("live/*", lambda _: None)
    one.on_connection(lambda _: None)
    one.announce("live/x")

def flood():
    while True:
        other.publish("topic/a", b"x" * 100)
        other.ask("rpc/a", b"", lambda _: None, 1000)

threading.Thread(target=flood, daemon=True).start()
busy.wait(5)
print("busy", flush=True)
"""


@pytest.mark.parametrize(
    "end,exit_code,last_words",
    [
        ("", 0, ""),
        ("bus.close()", 0, ""),
        ("sys.exit(3)", 3, ""),
        ("raise ValueError('on the way')", 1, "ValueError: on the way"),
        ("signal.raise_signal(signal.SIGINT)", -signal.SIGINT, "KeyboardInterrupt"),
    ],
)
def test_the_interpreter_exits_under_traffic_without_closing(
    endpoint: str, end: str, exit_code: int, last_words: str
) -> None:
    with start(_UNDER_TRAFFIC + end, endpoint) as process:
        try:
            output, errors = process.communicate(timeout=DEADLINE_S)
        finally:
            process.kill()
    assert (process.returncode, output, errors.strip().splitlines()[-1:]) == (
        exit_code,
        "busy\n",
        [last_words] if last_words else [],
    )
