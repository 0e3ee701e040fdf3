"""The bus in memory: the public fake of ZenohBus, deterministic, for tests and simulations in one process."""

import threading
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from itertools import chain
from typing import Generic, TypeVar

from services.runtime.bus import CALLBACK_FAILED, BusError, Presence, Received, Reply, Request
from services.runtime.callback_guard import CallbackGuard
from services.runtime.clock import Clock
from services.runtime.key_expression import checked_key, checked_key_expression, matches
from services.runtime.replies import AnsweredOnce, AsksServers, Outcome

T = TypeVar("T")


class MemoryHub:
    """What the buses of one process meet on, in the place of a router.

    Everything sent is queued, in one order over all buses, until `deliver_all`. With `inline` it is delivered
    before the sending call returns, or by the thread that is delivering already. Any thread may use it; exact
    repetition needs one thread.
    """

    def __init__(self, clock: Clock | None = None, *, inline: bool = False) -> None:
        self.lock = threading.RLock()
        self.buses: list[MemoryBus] = []
        self.asks: list[_Ask] = []
        self._clock = clock
        self._inline = inline
        self._deliveries: deque[Callable[[], object]] = deque()
        self._delivering = False

    def deliver_all(self) -> int:
        """Run what is queued, and what that queues, in order; returns how many deliveries ran."""
        with self.lock:
            if self._delivering:
                return 0
            self._delivering = True
        count = 0
        while (delivery := self._next_delivery()) is not None:
            delivery()
            count += 1
        return count

    def expire_requests(self) -> int:
        """Answer None to the open asks whose time is up, or to all without a clock; returns how many."""
        with self.lock:
            now_ns = self.now_ns()
            due = [ask for ask in self.asks if self._clock is None or ask.expires_ns <= now_ns]
            for ask in due:
                ask.finish(None)
        self.settle()
        return len(due)

    def now_ns(self) -> int:
        """The clock's time, 0 without a clock."""
        return self._clock.now_ns() if self._clock is not None else 0

    def enqueue(self, delivery: Callable[[], object]) -> None:
        """Queue one delivery; called with the lock held."""
        self._deliveries.append(delivery)

    def settle(self) -> None:
        """Deliver now if the hub is inline; called without the lock, so that callbacks never run under it."""
        if self._inline:
            self.deliver_all()

    def update_presence(self) -> None:
        """Queue, for every watcher, what has changed since it was last told; called with the lock held."""
        for bus in self.buses:
            for watch in bus.watches:
                watch.update(
                    {key for other in self.buses if other.online and bus.online for key in other.tokens}
                )

    def _next_delivery(self) -> Callable[[], object] | None:
        with self.lock:
            if self._deliveries:
                return self._deliveries.popleft()
            # Under the lock: a thread that queues something after this must not count on us to run it.
            self._delivering = False
            return None


class MemoryBus(AsksServers):
    """A Bus (see bus.py) on a hub shared with other buses, or with nobody but itself."""

    def __init__(self, hub: MemoryHub | None = None) -> None:
        self.hub = hub or MemoryHub()
        self.guard = CallbackGuard()
        self.online = True
        self.closed = False
        self.subscriptions: list[_Declared[Received]] = []
        self.servers: list[_Declared[Request]] = []
        self.watches: list[_Watch] = []
        self.tokens: list[str] = []
        self._connection_watchers: list[Callable[[bool], None]] = []
        with self.hub.lock:
            self.hub.buses.append(self)

    @property
    def callback_errors(self) -> int:
        """See Bus."""
        return self.guard.errors

    def publish(self, key: str, payload: bytes) -> None:
        """See Topics."""
        received = Received(checked_key(key), bytes(payload))
        with self.hub.lock:
            subscriptions = chain.from_iterable(bus.subscriptions for bus in self._reachable())
            for subscription in _matching(key, subscriptions):
                self.hub.enqueue(partial(subscription.call, "subscribe", received))
        self.hub.settle()

    def subscribe(self, key_expression: str, receive: Callable[[Received], None]) -> None:
        """See Topics."""
        with self.hub.lock:
            self._check_declaration(key_expression)
            self.subscriptions.append(_Declared(self, key_expression, receive))

    def serve(
        self, key_expression: str, receive: Callable[[Request], None], *, shared: bool = False
    ) -> Callable[[], None]:
        """See Requests."""
        with self.hub.lock:
            self._check_declaration(key_expression)
            server = _Declared(self, key_expression, receive, shared=shared)
            self.servers.append(server)
        return partial(self._withdraw, self.servers, server)

    def _ask(self, key: str, payload: bytes, outcome_of: Callable[[int], Outcome], timeout_ms: int) -> None:
        checked_key(key)
        if timeout_ms <= 0:
            message = f"timeout_ms = {timeout_ms}: an ask needs a positive timeout"
            raise ValueError(message)
        with self.hub.lock:
            servers = self._servers_of(key)
            take = outcome_of(len(servers))
            if not servers:
                self.hub.enqueue(partial(self.guard.call, "ask", take, None))
            expires_ns = self.hub.now_ns() + timeout_ms * 1_000_000
            for server in servers:
                ask = _Ask(self, server.bus, take, expires_ns)
                self.hub.asks.append(ask)
                self.hub.enqueue(partial(_call_server, server, ask, key, bytes(payload)))
        self.hub.settle()

    def _servers_of(self, key: str) -> "list[_Declared[Request]]":
        """Return the first who serves the key alone, else all who share it."""
        servers = _matching(key, chain.from_iterable(bus.servers for bus in self._reachable()))
        return next(([server] for server in servers if not server.shared), servers)

    def announce(self, key: str) -> Callable[[], None]:
        """See PresenceBoard."""
        checked_key(key)
        announced = [key]

        def withdraw() -> None:
            with self.hub.lock:
                if announced and not self.closed:
                    self.tokens.remove(announced.pop())
                    self.hub.update_presence()
            self.hub.settle()

        with self.hub.lock:
            self._check_declaration(key)
            self.tokens.append(key)
            self.hub.update_presence()
        self.hub.settle()
        return withdraw

    def watch(self, key_expression: str, receive: Callable[[Presence], None]) -> Callable[[], None]:
        """See PresenceBoard."""
        with self.hub.lock:
            self._check_declaration(key_expression)
            watch = _Watch(_Declared(self, key_expression, receive))
            self.watches.append(watch)
            self.hub.update_presence()
        self.hub.settle()
        return partial(self._withdraw, self.watches, watch)

    def _withdraw(self, declarations: list[T], declared: T) -> None:
        with self.hub.lock:
            if declared in declarations:
                declarations.remove(declared)

    def connected(self) -> bool:
        """See Connection."""
        return self.online

    def on_connection(self, receive: Callable[[bool], None]) -> None:
        """See Connection."""
        with self.hub.lock:
            self._connection_watchers.append(receive)
            self._tell_connection(receive)
        self.hub.settle()

    def set_online(self, *, online: bool) -> None:
        """Cut this bus off from the hub, as a failing network does, or bring it back with all it declared."""
        with self.hub.lock:
            if not self.closed and online != self.online:
                self._change_online(online=online)
        self.hub.settle()

    def close(self) -> None:
        """See Bus."""
        with self.hub.lock:
            if self.closed:
                return
            if self.online:
                self._change_online(online=False)
            self.closed = True
            self.hub.buses.remove(self)
        self.hub.settle()

    def _reachable(self) -> list["MemoryBus"]:
        """This bus first, then the others, unless it is cut off; nobody once it is closed."""
        if self.closed:
            return []
        others = [bus for bus in self.hub.buses if bus is not self and bus.online and self.online]
        return [self, *others]

    def _change_online(self, *, online: bool) -> None:
        self.online = online
        if not online:
            for ask in [ask for ask in self.hub.asks if self in {ask.asker, ask.server}]:
                ask.finish(None)
        self.hub.update_presence()
        for receive in self._connection_watchers:
            self._tell_connection(receive)

    def _tell_connection(self, receive: Callable[[bool], None]) -> None:
        online = self.online
        self.hub.enqueue(lambda: self.guard.call("on_connection", receive, online))

    def _check_declaration(self, key_expression: str) -> None:
        checked_key_expression(key_expression)
        if self.closed:
            message = f"cannot declare {key_expression!r}: the bus is closed"
            raise BusError(message)


class _Declared(Generic[T]):
    """One subscription, server or watch of a bus."""

    def __init__(
        self, bus: MemoryBus, key_expression: str, receive: Callable[[T], None], *, shared: bool = False
    ) -> None:
        self.bus = bus
        self.key_expression = key_expression
        self.shared = shared
        self._receive = receive

    def call(self, what: str, argument: T) -> bool:
        """Hand `argument` to the callback, unless closed by now, and return whether it did not raise."""
        return self.bus.closed or self.bus.guard.call(what, self._receive, argument)


class _Watch:
    """One watcher of presence and what it was told so far."""

    def __init__(self, declared: _Declared[Presence]) -> None:
        self._declared = declared
        self._told: set[str] = set()

    def update(self, present: set[str]) -> None:
        """Queue the difference between what was told and the keys now present, the gone before the new."""
        declared = self._declared
        matching = {key for key in present if matches(declared.key_expression, key)}
        changes = [Presence(key, present=False) for key in sorted(self._told - matching)]
        changes += [Presence(key, present=True) for key in sorted(matching - self._told)]
        self._told = matching
        for change in changes:
            declared.bus.hub.enqueue(partial(declared.call, "watch", change))


class _Ask:
    """One question in flight; hands on the first outcome and forgets the rest."""

    def __init__(self, asker: MemoryBus, server: MemoryBus, receive: Outcome, expires_ns: int) -> None:
        self.asker = asker
        self.server = server
        self.expires_ns = expires_ns
        self._receive = receive

    def finish(self, outcome: Reply | None) -> None:
        """Queue `outcome` for the asker, unless there was one before."""
        hub = self.asker.hub
        with hub.lock:
            if self in hub.asks:
                hub.asks.remove(self)
                hub.enqueue(partial(self.asker.guard.call, "ask", self._receive, outcome))

    def answer(self, outcome: Reply | None) -> None:
        """Queue what the server said, and deliver it where the hub is inline."""
        self.finish(outcome)
        self.asker.hub.settle()


def _call_server(server: _Declared[Request], ask: _Ask, key: str, payload: bytes) -> None:
    request = AnsweredOnce(key, payload, ask.answer)
    if not server.call("serve", request):
        request.reply_error(CALLBACK_FAILED)


def _matching(key: str, declared: Iterable[_Declared[T]]) -> list[_Declared[T]]:
    return [one for one in declared if matches(one.key_expression, key)]
