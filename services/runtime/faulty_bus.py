"""A bus on virtual time that drops, delays, duplicates, reorders and cuts off, every fault drawn from a seed.

Each ordered pair of buses is a link with a stream of chance of its own, so that one more listener does not
change what happens to the others. Without faults it is a Bus like any other (tests/contract).
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from services.runtime.bus import CALLBACK_FAILED, BusError, Presence, Received, Reply, Request
from services.runtime.callback_guard import CallbackGuard
from services.runtime.faults import CALM, MS, Faults, Link, Observer, Seen
from services.runtime.key_expression import checked_key, checked_key_expression, matches
from services.runtime.replies import AnsweredOnce, AsksServers, Outcome
from services.runtime.timeline import Timeline, dice

LOSS_NOTICED_NS = 1 * MS
"""A connection that closes is noticed by its router about so soon."""


class FaultyHub:
    """Where buses meet; everything sent is an appointment of the timeline."""

    def __init__(
        self, timeline: Timeline, seed: int = 0, faults: Faults = CALM, observe: Observer | None = None
    ) -> None:
        self.timeline = timeline
        self.faults = faults
        self.buses: list[FaultyBus] = []
        self._seed = seed
        self._observe = observe
        self._links: dict[tuple[str, str], Link] = {}
        self._cut: dict[tuple[str, str], int] = {}
        self._asks = 0

    def cut(self, sender: str, receiver: str, span_ns: int) -> None:
        """Let nothing from `sender` reach `receiver` for a while."""
        until_ns = self.timeline.now_ns() + span_ns
        self._cut[sender, receiver] = max(until_ns, self._cut.get((sender, receiver), 0))
        self.see("cut", sender, receiver, "", f"{span_ns / 1e6:.0f} ms".encode())
        self.tell_presence()
        self.timeline.call_at(until_ns + 1, self.tell_presence)

    def is_cut(self, sender: str, receiver: str) -> bool:
        """Tell whether nothing gets from one to the other now."""
        return self._cut.get((sender, receiver), -1) >= self.timeline.now_ns()

    def heal(self) -> None:
        """No more faults from now on, and no link stays cut."""
        self.faults = CALM
        self._cut.clear()
        self.tell_presence()

    def see(
        self, what: str, sender: str, receiver: str, key: str = "", payload: bytes = b"", ask: int = 0
    ) -> None:
        """Tell the observer."""
        if self._observe is not None:
            self._observe(Seen(self.timeline.now_ns(), what, sender, receiver, key, payload, ask))

    def number_ask(self) -> int:
        """Return the number of a new question."""
        self._asks += 1
        return self._asks

    def send(self, parcel: "Parcel") -> None:
        """Carry something from one bus to another, as far as the faults let it."""
        sender, receiver = parcel.sender.name, parcel.receiver.name
        link = self._links.get((sender, receiver))
        if link is None:
            link = self._links[sender, receiver] = Link(dice(self._seed, "link", sender, receiver))
        own = parcel.sender is parcel.receiver
        faults = CALM if own else self.faults
        copies = 0 if not own and self.is_cut(sender, receiver) else link.copies(faults)
        if copies != 1:
            self.see("again" if copies else "lost", sender, receiver, parcel.key, parcel.payload, parcel.ask)
        now_ns = self.timeline.now_ns()
        for _ in range(copies):
            at_ns = link.arrival_ns(faults, now_ns, ordered=parcel.ordered)
            self.timeline.call_at(at_ns, partial(self._arrive, parcel))

    def tell_presence(self) -> None:
        """Have every watcher look who is there, after a while."""
        for bus in self.buses:
            for watch in bus.watches:
                link = dice(self._seed, "presence", bus.name, str(self.timeline.now_ns()))
                self.timeline.call_in(
                    int(link.random() * self.faults.presence_ms * MS), partial(watch.look, self)
                )

    def _arrive(self, parcel: "Parcel") -> None:
        sender, receiver = parcel.sender, parcel.receiver
        if receiver.closed or not receiver.online:
            return
        if sender is not receiver and self.is_cut(sender.name, receiver.name):
            self.see("lost", sender.name, receiver.name, parcel.key, parcel.payload, parcel.ask)
            return
        parcel.deliver()
        receiver.heard()


class Parcel(NamedTuple):
    """Something on its way; `deliver` hands it to the receiver."""

    sender: "FaultyBus"
    receiver: "FaultyBus"
    key: str
    payload: bytes
    deliver: Callable[[], object]
    ordered: bool = False
    ask: int = 0


class FaultyBus(AsksServers):
    """A Bus (see bus.py) by name on a hub; `heard` is called after everything that reached it."""

    def __init__(self, hub: FaultyHub, name: str, heard: Callable[[], None] = lambda: None) -> None:
        self.hub = hub
        self.name = name
        self.heard = heard
        self.guard = CallbackGuard()
        self.online = True
        self.closed = False
        self.subscriptions: list[tuple[str, Callable[[Received], None]]] = []
        self.servers: list[_Server] = []
        self.watches: list[_Watch] = []
        self.tokens: list[str] = []
        self._asking: dict[int, _Ask] = {}
        self._serving: dict[int, _Ask] = {}
        self._connection_watchers: list[Callable[[bool], None]] = []
        hub.buses.append(self)

    @property
    def callback_errors(self) -> int:
        """See Bus."""
        return self.guard.errors

    def publish(self, key: str, payload: bytes) -> None:
        """See Topics."""
        received = Received(checked_key(key), bytes(payload))
        if self.closed:
            return
        self.hub.see("publish", self.name, "", key, received.payload)
        for bus in self._reachable():
            for expression, receive in bus.subscriptions:
                if matches(expression, key):
                    deliver = partial(bus.hear, receive, received, self.name)
                    self.hub.send(Parcel(self, bus, key, received.payload, deliver, ordered=True))

    def hear(self, receive: Callable[[Received], None], received: Received, sender: str) -> None:
        """Hand a publication to its subscriber."""
        self.hub.see("hear", sender, self.name, received.key, received.payload)
        self.guard.call("subscribe", receive, received)

    def subscribe(self, key_expression: str, receive: Callable[[Received], None]) -> None:
        """See Topics."""
        self._check_declaration(key_expression)
        self.subscriptions.append((key_expression, receive))

    def serve(
        self, key_expression: str, receive: Callable[[Request], None], *, shared: bool = False
    ) -> Callable[[], None]:
        """See Requests."""
        self._check_declaration(key_expression)
        server = _Server(self, key_expression, receive, shared)
        self.servers.append(server)
        return lambda: self.servers.remove(server) if server in self.servers else None

    def _ask(self, key: str, payload: bytes, outcome_of: Callable[[int], Outcome], timeout_ms: int) -> None:
        checked_key(key)
        if timeout_ms <= 0:
            message = f"timeout_ms = {timeout_ms}: an ask needs a positive timeout"
            raise ValueError(message)
        servers = self._servers_of(key)
        take = outcome_of(len(servers))
        if self.closed:
            self.guard.call("ask", take, None)
            return
        if not servers:
            ask = self._question(key, payload, take, self, "")
            self.hub.timeline.call_in(LOSS_NOTICED_NS, partial(ask.finish, None))
        for server in servers:
            ask = self._question(key, payload, take, server.bus, server.bus.name)
            deliver = partial(ask.serve, server.receive)
            self.hub.send(Parcel(self, server.bus, key, ask.payload, deliver, ask=ask.number))
            self.hub.timeline.call_in(timeout_ms * MS, partial(ask.finish, None))

    def _question(self, key: str, payload: bytes, take: Outcome, server: "FaultyBus", name: str) -> "_Ask":
        number = self.hub.number_ask()
        ask = self._asking[number] = _Ask(self, server, number, key, bytes(payload), take)
        self.hub.see("ask", self.name, name, key, ask.payload, number)
        return ask

    def announce(self, key: str) -> Callable[[], None]:
        """See PresenceBoard."""
        checked_key(key)
        self._check_declaration(key)
        announced = [key]
        self.tokens.append(key)
        self.hub.tell_presence()

        def withdraw() -> None:
            if announced and not self.closed:
                self.tokens.remove(announced.pop())
                self.hub.tell_presence()

        return withdraw

    def watch(self, key_expression: str, receive: Callable[[Presence], None]) -> Callable[[], None]:
        """See PresenceBoard."""
        self._check_declaration(key_expression)
        watch = _Watch(self, key_expression, receive)
        self.watches.append(watch)
        self.hub.tell_presence()
        return lambda: self.watches.remove(watch) if watch in self.watches else None

    def connected(self) -> bool:
        """See Connection."""
        return self.online

    def on_connection(self, receive: Callable[[bool], None]) -> None:
        """See Connection."""
        self._connection_watchers.append(receive)
        self._tell_connection(receive)

    def set_online(self, *, online: bool) -> None:
        """Cut this bus off from its router, or bring it back with all it declared."""
        if self.closed or online == self.online:
            return
        self.online = online
        self.hub.see("online" if online else "offline", self.name, "")
        if not online:
            self._drop_asks()
        self.hub.tell_presence()
        for receive in self._connection_watchers:
            self._tell_connection(receive)

    def close(self) -> None:
        """See Bus: what was asked here is answered with None, and what was to be answered here never is."""
        if self.closed:
            return
        self.online = False
        self._drop_asks()
        for receive in self._connection_watchers:
            self._tell_connection(receive)
        self.closed = True
        self.hub.buses.remove(self)
        self.hub.tell_presence()

    def kill(self) -> None:
        """End as a process does that dies: nobody in it hears anything any more."""
        self.closed, self.online = True, False
        self.hub.buses.remove(self)
        self._asking.clear()
        for ask in list(self._serving.values()):
            ask.server_lost()
        self.hub.tell_presence()

    def settled(self, ask: "_Ask") -> None:
        """Forget a question that has its outcome."""
        self._asking.pop(ask.number, None)
        ask.server.released(ask)

    def received(self, ask: "_Ask") -> None:
        """Keep in mind that this bus is to answer."""
        self._serving[ask.number] = ask

    def released(self, ask: "_Ask") -> None:
        """This bus need not answer any more."""
        self._serving.pop(ask.number, None)

    def _drop_asks(self) -> None:
        for ask in list(self._asking.values()):
            ask.finish(None)
        for ask in list(self._serving.values()):
            ask.server_lost()

    def _servers_of(self, key: str) -> "list[_Server]":
        servers = [one for bus in self._reachable() for one in bus.servers if matches(one.expression, key)]
        return next(([server] for server in servers if not server.shared), servers)

    def _reachable(self) -> "list[FaultyBus]":
        if self.closed:
            return []
        return [self, *(bus for bus in self.hub.buses if bus is not self and bus.online and self.online)]

    def _tell_connection(self, receive: Callable[[bool], None]) -> None:
        online = self.online

        def tell() -> None:
            if not self.closed or not online:
                self.guard.call("on_connection", receive, online)
                self.heard()

        self.hub.timeline.call_in(0, tell)

    def _check_declaration(self, key_expression: str) -> None:
        checked_key_expression(key_expression)
        if self.closed:
            message = f"cannot declare {key_expression!r}: the bus is closed"
            raise BusError(message)


class _Server(NamedTuple):
    """One server of a bus."""

    bus: FaultyBus
    expression: str
    receive: Callable[[Request], None]
    shared: bool


class _Watch:
    """One watcher of presence and what it was told so far."""

    def __init__(self, bus: FaultyBus, key_expression: str, receive: Callable[[Presence], None]) -> None:
        self._bus, self._expression, self._receive = bus, key_expression, receive
        self._told: set[str] = set()

    def look(self, hub: FaultyHub) -> None:
        """Tell the difference between what was told and who is there, the gone before the new."""
        bus = self._bus
        if bus.closed:
            return
        seen = [
            other
            for other in hub.buses
            if other is bus or (other.online and bus.online and not hub.is_cut(other.name, bus.name))
        ]
        present = {key for other in seen for key in other.tokens if matches(self._expression, key)}
        changes = [Presence(key, present=False) for key in sorted(self._told - present)]
        changes += [Presence(key, present=True) for key in sorted(present - self._told)]
        self._told = present
        for change in changes:
            hub.see("present" if change.present else "gone", "", bus.name, change.key)
            bus.guard.call("watch", self._receive, change)
        if changes:
            bus.heard()


class _Ask:
    """One question; its first outcome counts."""

    def __init__(
        self, asker: FaultyBus, server: FaultyBus, number: int, key: str, payload: bytes, receive: Outcome
    ) -> None:
        self.asker, self.server, self.number, self.key, self.payload = asker, server, number, key, payload
        self._receive: Outcome | None = receive

    def serve(self, receive: Callable[[Request], None]) -> None:
        """Hand the question to its server; a repeated one is a question of its own."""
        server = self.server
        server.received(self)
        server.hub.see("serve", self.asker.name, server.name, self.key, self.payload, self.number)
        request = AnsweredOnce(self.key, self.payload, self.answer)
        if not server.guard.call("serve", receive, request):
            request.reply_error(CALLBACK_FAILED)

    def answer(self, reply: Reply | None) -> None:
        """Send the server's reply."""
        server = self.server
        if server.closed:
            return
        payload = reply.payload if reply is not None else b""
        if reply is not None:
            what = "reply" if reply.ok else "error"
            server.hub.see(what, server.name, self.asker.name, self.key, payload, self.number)
        deliver = partial(self.finish, reply)
        server.hub.send(Parcel(server, self.asker, self.key, payload, deliver, ask=self.number))

    def server_lost(self) -> None:
        """The server died: its router tells the asker, or nobody does and the question times out."""
        hub = self.server.hub
        if hub.faults is CALM or self.number % 2:
            hub.timeline.call_in(LOSS_NOTICED_NS, partial(self.finish, None))

    def finish(self, outcome: Reply | None) -> None:
        """Hand the first outcome to the asker."""
        receive, self._receive = self._receive, None
        self.asker.settled(self)
        if receive is None or self.asker.closed:
            return
        what, payload = ("unanswered", b"") if outcome is None else ("answered", outcome.payload)
        self.asker.hub.see(what, self.server.name, self.asker.name, self.key, payload, self.number)
        self.asker.guard.call("ask", receive, outcome)
        self.asker.heard()
