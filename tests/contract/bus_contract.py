"""What every bus has to do, as tests that are the same for each implementation (see services/runtime/bus.py).

A subclass gives a `world` fixture: where its buses come from, and how to wait for what they deliver.
"""

import queue
import threading
from abc import ABC, abstractmethod
from typing import NamedTuple, TypeVar

import pytest

from services.runtime.bus import CALLBACK_FAILED, Bus, BusError, Presence, Received, Reply, Request

T = TypeVar("T")
DEADLINE_S = 5.0
LONG_MS = 10_000


class World(ABC):
    """Where the buses of one test live."""

    @abstractmethod
    def open(self) -> Bus:
        """Return a new bus; the world closes it after the test."""

    @abstractmethod
    def settle(self) -> None:
        """Return once everything declared and sent so far has reached everybody."""

    @abstractmethod
    def pass_time(self) -> None:
        """Let the timeouts of the open asks pass, where time is simulated."""

    def next(self, inbox: "queue.SimpleQueue[T]") -> T:
        """Return the next thing that arrives in `inbox`."""
        self.settle()
        return inbox.get(timeout=DEADLINE_S)

    def rest(self, inbox: "queue.SimpleQueue[T]") -> list[T]:
        """Return everything that has arrived in `inbox` by now."""
        self.settle()
        return [inbox.get_nowait() for _ in range(inbox.qsize())]


def raise_always(argument: object) -> None:
    """A callback with a fault."""
    raise LookupError(argument)


class OpenAsk(NamedTuple):
    """A request that its server holds, and where its answer is waited for."""

    asker: Bus
    server: Bus
    answers: "queue.SimpleQueue[Reply | None]"
    held: Request


def held_request(world: World, timeout_ms: int = LONG_MS) -> OpenAsk:
    """Ask, and let the server take the request without an answer."""
    asker, server = world.open(), world.open()
    answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
    server.serve("rpc", requests.put)
    world.settle()
    asker.ask("rpc", b"", answers.put, timeout_ms)
    return OpenAsk(asker, server, answers, world.next(requests))


def told_to_asker(world: World, open_ask: OpenAsk) -> list[Reply | None]:
    """Return all that the asker is told, though the server replies after the first of it."""
    first = world.next(open_ask.answers)
    open_ask.held.reply(b"too late")
    return [first, *world.rest(open_ask.answers)]


class BusContract:
    """The contract; subclasses are collected by pytest."""

    def test_a_message_reaches_every_subscriber_in_order_and_not_the_others(self, world: World) -> None:
        publisher, one, two = world.open(), world.open(), world.open()
        at_one: queue.SimpleQueue[Received] = queue.SimpleQueue()
        at_two: queue.SimpleQueue[Received] = queue.SimpleQueue()
        at_other: queue.SimpleQueue[Received] = queue.SimpleQueue()
        one.subscribe("topic/a", at_one.put)
        two.subscribe("topic/a", at_two.put)
        two.subscribe("topic/b", at_other.put)
        world.settle()
        sent = [Received("topic/a", payload) for payload in (b"first", b"", b"\x00\xff")]
        for message in sent:
            publisher.publish(message.key, message.payload)
        assert [world.next(at_one) for _ in sent] == sent
        assert [world.next(at_two) for _ in sent] == sent
        assert world.rest(at_other) == []

    def test_a_bus_hears_its_own_messages(self, world: World) -> None:
        bus = world.open()
        inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()
        bus.subscribe("topic", inbox.put)
        bus.publish("topic", b"x")
        assert world.next(inbox) == Received("topic", b"x")
        assert world.rest(inbox) == []

    @pytest.mark.parametrize(
        "key_expression,heard",
        [
            ("s/*/state", ["s/1/state"]),
            ("s/**", ["s", "s/1/state", "s/1/event/x"]),
            ("**/x", ["s/1/event/x"]),
            ("s/1/st$*", ["s/1/state"]),
            ("s/1/@adv", ["s/1/@adv"]),
        ],
    )
    def test_a_wildcard_hears_what_it_stands_for(
        self, world: World, key_expression: str, heard: list[str]
    ) -> None:
        publisher, subscriber = world.open(), world.open()
        inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()
        subscriber.subscribe(key_expression, inbox.put)
        subscriber.subscribe("end", inbox.put)
        world.settle()
        for key in ("s", "s/1/state", "s/1/event/x", "s/1/@adv", "t/1/state", "end"):
            publisher.publish(key, b"")
        assert [world.next(inbox).key for _ in range(len(heard) + 1)] == [*heard, "end"]

    def test_a_late_subscriber_gets_only_what_comes_after(self, world: World) -> None:
        publisher, subscriber = world.open(), world.open()
        inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()
        publisher.publish("topic", b"before")
        world.settle()
        subscriber.subscribe("topic", inbox.put)
        world.settle()
        publisher.publish("topic", b"after")
        assert world.next(inbox) == Received("topic", b"after")

    def test_a_request_is_answered_by_its_server(self, world: World) -> None:
        asker, server = world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        server.serve("rpc/*", lambda request: request.reply(request.key.encode() + b"=" + request.payload))
        world.settle()
        asker.ask("rpc/double", b"21", answers.put, LONG_MS)
        assert world.next(answers) == Reply(b"rpc/double=21", ok=True)
        assert world.rest(answers) == []

    def test_an_error_reply_arrives_as_one(self, world: World) -> None:
        asker, server = world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        server.serve("rpc", lambda request: request.reply_error(b"no such step"))
        world.settle()
        asker.ask("rpc", b"", answers.put, LONG_MS)
        assert world.next(answers) == Reply(b"no such step", ok=False)

    def test_only_the_first_answer_counts(self, world: World) -> None:
        asker, server = world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()

        def answer_thrice(request: Request) -> None:
            request.reply(b"first")
            request.reply(b"second")
            request.reply_error(b"third")

        server.serve("rpc", answer_thrice)
        world.settle()
        asker.ask("rpc", b"", answers.put, LONG_MS)
        assert world.next(answers) == Reply(b"first", ok=True)
        assert world.rest(answers) == []

    def test_a_request_is_answered_later_by_another_thread(self, world: World) -> None:
        asker, server = world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
        server.serve("rpc", requests.put)
        world.settle()
        asker.ask("rpc", b"1", answers.put, LONG_MS)
        asker.ask("rpc", b"2", answers.put, LONG_MS)
        held = [world.next(requests), world.next(requests)]
        assert world.rest(answers) == []

        def answer_in_reverse() -> None:
            for request in reversed(held):
                request.reply(b"late " + request.payload)

        thread = threading.Thread(target=answer_in_reverse)
        thread.start()
        thread.join()
        assert [world.next(answers), world.next(answers)] == [Reply(b"late 2"), Reply(b"late 1")]

    def test_one_of_several_servers_gets_the_request(self, world: World) -> None:
        asker, one, two = world.open(), world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
        for server in (one, two):
            server.serve("rpc", requests.put)
        world.settle()
        asker.ask("rpc", b"", answers.put, LONG_MS)
        world.next(requests).reply(b"done")
        assert world.next(answers) == Reply(b"done")
        assert world.rest(requests) == []

    def test_a_server_on_the_askers_own_bus_goes_first(self, world: World) -> None:
        asker, other = world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        elsewhere: queue.SimpleQueue[Request] = queue.SimpleQueue()
        other.serve("rpc", elsewhere.put)
        asker.serve("rpc", lambda request: request.reply(b"own"))
        world.settle()
        asker.ask("rpc", b"", answers.put, LONG_MS)
        assert world.next(answers) == Reply(b"own")
        assert world.rest(elsewhere) == []

    def test_of_those_who_share_a_key_the_one_who_replies_is_heard_at_once(self, world: World) -> None:
        asker, knows, drops, holds = (world.open() for _ in range(4))
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        held: queue.SimpleQueue[Request] = queue.SimpleQueue()
        drops.serve("rpc/*", lambda _: None, shared=True)
        holds.serve("rpc/*", held.put, shared=True)
        knows.serve("rpc/*", lambda request: request.reply(request.payload + b"!"), shared=True)
        world.settle()
        asker.ask("rpc/a", b"x", answers.put, LONG_MS)
        assert world.next(answers) == Reply(b"x!")
        world.next(held).reply(b"too late")
        assert world.rest(answers) == []

    def test_where_all_who_share_a_key_drop_the_request_there_is_no_answer(self, world: World) -> None:
        asker, one, two = world.open(), world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        for server in (one, two, asker):
            server.serve("rpc", lambda _: None, shared=True)
        world.settle()
        asker.ask("rpc", b"", answers.put, LONG_MS)
        assert world.next(answers) is None
        assert world.rest(answers) == []

    def test_all_who_share_a_key_are_heard_also_twice_on_one_bus(self, world: World) -> None:
        asker, one, two = world.open(), world.open(), world.open()
        answers: queue.SimpleQueue[tuple[Reply, ...]] = queue.SimpleQueue()
        one.serve("rpc", lambda request: request.reply(b"one"), shared=True)
        one.serve("rpc", lambda request: request.reply(b"again"), shared=True)
        two.serve("rpc", lambda request: request.reply_error(b"two"), shared=True)
        asker.serve("rpc", lambda request: request.reply(b"own"), shared=True)
        two.serve("rpc", lambda _: None, shared=True)
        world.settle()
        asker.ask_all("rpc", b"", answers.put, LONG_MS)
        expected = {Reply(b"one"), Reply(b"again"), Reply(b"two", ok=False), Reply(b"own")}
        heard = world.next(answers)
        assert (set(heard), len(heard)) == (expected, 4)

    def test_who_serves_a_key_alone_goes_before_those_who_share_it(self, world: World) -> None:
        asker, alone, shares = world.open(), world.open(), world.open()
        answers: queue.SimpleQueue[tuple[Reply, ...]] = queue.SimpleQueue()
        shares.serve("rpc/*", lambda request: request.reply(b"shared"), shared=True)
        alone.serve("rpc/a", lambda request: request.reply(b"alone"))
        world.settle()
        asker.ask_all("rpc/a", b"", answers.put, LONG_MS)
        assert world.next(answers) == (Reply(b"alone"),)
        asker.ask_all("rpc/b", b"", answers.put, LONG_MS)
        assert world.next(answers) == (Reply(b"shared"),)
        asker.ask_all("nobody", b"", answers.put, LONG_MS)
        assert world.next(answers) == ()

    def test_asking_all_ends_at_its_timeout_with_what_came(self, world: World) -> None:
        asker, replies, holds = world.open(), world.open(), world.open()
        answers: queue.SimpleQueue[tuple[Reply, ...]] = queue.SimpleQueue()
        held: queue.SimpleQueue[Request] = queue.SimpleQueue()
        replies.serve("rpc", lambda request: request.reply(b"here"), shared=True)
        holds.serve("rpc", held.put, shared=True)
        world.settle()
        asker.ask_all("rpc", b"", answers.put, 200)
        request = world.next(held)
        world.settle()
        world.pass_time()
        assert world.next(answers) == (Reply(b"here"),)
        request.reply(b"too late")
        assert world.rest(answers) == []

    def test_a_server_that_is_withdrawn_serves_no_more_and_twice_is_once(self, world: World) -> None:
        asker, server, other = world.open(), world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        withdraw = server.serve("rpc", lambda request: request.reply(b"first"))
        world.settle()
        server.ask("rpc", b"", answers.put, LONG_MS)
        assert world.next(answers) == Reply(b"first")
        withdraw()
        withdraw()
        other.serve("rpc", lambda request: request.reply(b"other"))
        world.settle()
        for bus in (asker, server):
            bus.ask("rpc", b"", answers.put, LONG_MS)
            assert world.next(answers) == Reply(b"other")

    def test_a_watch_that_is_withdrawn_tells_nothing_and_the_next_one_everything(self, world: World) -> None:
        watcher, other = world.open(), world.open()
        first: queue.SimpleQueue[Presence] = queue.SimpleQueue()
        second: queue.SimpleQueue[Presence] = queue.SimpleQueue()
        other.announce("here/a")
        world.settle()
        withdraw = watcher.watch("here/*", first.put)
        assert world.next(first) == Presence("here/a", present=True)
        withdraw()
        withdraw()
        world.settle()
        other.announce("here/b")
        world.settle()
        watcher.watch("here/*", second.put)
        seen = {world.next(second), world.next(second)}
        assert seen == {Presence("here/a", present=True), Presence("here/b", present=True)}
        assert world.rest(first) == []

    def test_a_key_nobody_serves_has_no_answer(self, world: World) -> None:
        asker, server = world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        server.serve("rpc/a", lambda request: request.reply(b""))
        world.settle()
        asker.ask("rpc/b", b"", answers.put, LONG_MS)
        assert world.next(answers) is None

    def test_a_request_that_is_dropped_has_no_answer(self, world: World) -> None:
        asker, server = world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        server.serve("rpc", lambda _: None)
        world.settle()
        asker.ask("rpc", b"", answers.put, LONG_MS)
        assert world.next(answers) is None

    def test_a_server_that_closes_leaves_its_requests_without_an_answer(self, world: World) -> None:
        open_ask = held_request(world)
        open_ask.server.close()
        assert told_to_asker(world, open_ask) == [None]

    def test_a_timeout_is_no_answer_and_a_reply_after_it_is_lost(self, world: World) -> None:
        open_ask = held_request(world, 50)
        world.pass_time()
        assert told_to_asker(world, open_ask) == [None]

    def test_closing_answers_the_open_asks_with_nothing(self, world: World) -> None:
        open_ask = held_request(world)
        open_ask.asker.close()
        assert told_to_asker(world, open_ask) == [None]

    def test_a_raising_callback_is_counted_and_keeps_its_subscription(
        self, world: World, caplog: pytest.LogCaptureFixture
    ) -> None:
        publisher, subscriber = world.open(), world.open()
        inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()

        def fail_twice(message: Received) -> None:
            if message.payload != b"good":
                raise_always(message)
            inbox.put(message)

        subscriber.subscribe("topic", fail_twice)
        world.settle()
        for payload in (b"bad", b"bad", b"good"):
            publisher.publish("topic", payload)
        assert world.next(inbox) == Received("topic", b"good")
        assert (publisher.callback_errors, subscriber.callback_errors) == (0, 2)
        assert [record.levelname for record in caplog.records] == ["ERROR"]

    def test_a_request_whose_callback_raised_gets_an_error_reply(self, world: World) -> None:
        asker, server = world.open(), world.open()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        server.serve("rpc", raise_always)
        world.settle()
        for _ in range(2):
            asker.ask("rpc", b"", answers.put, LONG_MS)
            assert world.next(answers) == Reply(CALLBACK_FAILED, ok=False)
        assert server.callback_errors == 2

    def test_presence_tells_who_is_there_who_comes_and_who_goes(self, world: World) -> None:
        first, second, watcher = world.open(), world.open(), world.open()
        inbox: queue.SimpleQueue[Presence] = queue.SimpleQueue()
        withdraw = first.announce("live/teacher/ann")
        first.announce("other")
        world.settle()
        watcher.watch("live/*/*", inbox.put)
        assert world.next(inbox) == Presence("live/teacher/ann", present=True)
        second.announce("live/teacher/bob")
        assert world.next(inbox) == Presence("live/teacher/bob", present=True)
        withdraw()
        withdraw()
        assert world.next(inbox) == Presence("live/teacher/ann", present=False)
        second.close()
        assert world.next(inbox) == Presence("live/teacher/bob", present=False)
        assert world.rest(inbox) == []

    def test_two_holders_of_one_key_are_one_presence(self, world: World) -> None:
        first, second, watcher = world.open(), world.open(), world.open()
        inbox: queue.SimpleQueue[Presence] = queue.SimpleQueue()
        watcher.watch("live", inbox.put)
        first.announce("live")
        world.settle()
        second.announce("live")
        world.settle()
        first.close()
        assert world.rest(inbox) == [Presence("live", present=True)]
        second.close()
        assert world.next(inbox) == Presence("live", present=False)

    def test_the_connection_is_reported_with_its_end(self, world: World) -> None:
        bus = world.open()
        states: queue.SimpleQueue[bool] = queue.SimpleQueue()
        bus.on_connection(states.put)
        assert (world.next(states), bus.connected()) == (True, True)
        bus.close()
        assert (world.next(states), bus.connected()) == (False, False)
        assert world.rest(states) == []

    def test_after_closing_nothing_is_sent_and_nothing_can_be_declared(self, world: World) -> None:
        bus, other = world.open(), world.open()
        inbox: queue.SimpleQueue[Received] = queue.SimpleQueue()
        answers: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        other.subscribe("topic", inbox.put)
        other.serve("rpc", lambda request: request.reply(b""))
        withdraw = bus.announce("live")
        world.settle()
        bus.close()
        bus.close()
        withdraw()
        bus.publish("topic", b"")
        bus.ask("rpc", b"", answers.put, LONG_MS)
        assert world.next(answers) is None
        assert world.rest(inbox) == []
        for declare in (bus.subscribe, bus.serve, bus.watch):
            with pytest.raises(BusError, match="closed"):
                declare("topic", raise_always)
        with pytest.raises(BusError, match="closed"):
            bus.announce("live")

    @pytest.mark.parametrize("key", ["", "/a", "a/", "a//b", "a/*", "**", "a$*", "a?b", "a#b"])
    def test_a_key_that_is_not_concrete_or_malformed_is_refused(self, world: World, key: str) -> None:
        bus = world.open()
        with pytest.raises(ValueError, match="key"):
            bus.publish(key, b"")
        with pytest.raises(ValueError, match="key"):
            bus.ask(key, b"", raise_always, LONG_MS)
        with pytest.raises(ValueError, match="key"):
            bus.announce(key)

    @pytest.mark.parametrize(
        "key_expression", ["", "/a", "a*", "a/$*", "**/*", "**/**", "a//**", "a?", "a$b"]
    )
    def test_a_malformed_key_expression_is_refused(self, world: World, key_expression: str) -> None:
        bus = world.open()
        for declare in (bus.subscribe, bus.serve, bus.watch):
            with pytest.raises(ValueError, match="key"):
                declare(key_expression, raise_always)

    @pytest.mark.parametrize("timeout_ms", [0, -1])
    def test_an_ask_needs_a_positive_timeout(self, world: World, timeout_ms: int) -> None:
        with pytest.raises(ValueError, match="timeout_ms"):
            world.open().ask("rpc", b"", raise_always, timeout_ms)
