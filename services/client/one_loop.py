"""A bus for clients that live in somebody else's loop: it wakes that loop, and declares each thing once.

A `Client` waits on an inbox of its own. Where many of them, or a client and a service, share one thread,
each gets the common bus through a `LoopBus`: `wake` is called after everything that comes, and the loop then
empties the client by `next(0)` (and once `due_ns` has passed). A client that is closed can be followed by
another on the same LoopBus: subscriptions, which a bus never takes back, are used again.
"""

from collections.abc import Callable

from services.runtime.bus import Bus, Presence, Received, Reply, Request


class LoopBus:
    """A Bus (see services.runtime.bus) whose callbacks are followed by `wake`; one client at a time."""

    def __init__(self, bus: Bus, wake: Callable[[], None]) -> None:
        self._bus, self._wake = bus, wake
        self._subscribed: dict[str, Callable[[Received], None]] = {}
        self._on_connection: Callable[[bool], None] | None = None

    @property
    def callback_errors(self) -> int:
        """See Bus."""
        return self._bus.callback_errors

    def release(self) -> None:
        """Hand nothing more to the client that was here; the subscriptions wait for the next one."""
        for key_expression in self._subscribed:
            self._subscribed[key_expression] = _nobody
        if self._on_connection is not None:
            self._on_connection = _nobody

    def publish(self, key: str, payload: bytes) -> None:
        """See Topics."""
        self._bus.publish(key, payload)

    def subscribe(self, key_expression: str, receive: Callable[[Received], None]) -> None:
        """See Topics; a second subscription of the same keys takes the place of the first."""
        known = key_expression in self._subscribed
        self._subscribed[key_expression] = receive
        if not known:
            self._bus.subscribe(key_expression, lambda received: self._received(key_expression, received))

    def serve(
        self, key_expression: str, receive: Callable[[Request], None], *, shared: bool = False
    ) -> Callable[[], None]:
        """See Requests."""
        return self._bus.serve(key_expression, receive, shared=shared)

    def ask(self, key: str, payload: bytes, receive: Callable[[Reply | None], None], timeout_ms: int) -> None:
        """See Requests."""

        def replied(reply: Reply | None) -> None:
            receive(reply)
            self._wake()

        self._bus.ask(key, payload, replied, timeout_ms)

    def ask_all(
        self, key: str, payload: bytes, receive: Callable[[tuple[Reply, ...]], None], timeout_ms: int
    ) -> None:
        """See Requests."""

        def replied(replies: tuple[Reply, ...]) -> None:
            receive(replies)
            self._wake()

        self._bus.ask_all(key, payload, replied, timeout_ms)

    def announce(self, key: str) -> Callable[[], None]:
        """See PresenceBoard."""
        return self._bus.announce(key)

    def watch(self, key_expression: str, receive: Callable[[Presence], None]) -> Callable[[], None]:
        """See PresenceBoard."""
        return self._bus.watch(key_expression, receive)

    def connected(self) -> bool:
        """See Connection."""
        return self._bus.connected()

    def on_connection(self, receive: Callable[[bool], None]) -> None:
        """See Connection; a second receiver takes the place of the first and is told the present state."""
        known = self._on_connection is not None
        self._on_connection = receive
        if known:
            receive(self._bus.connected())
        else:
            self._bus.on_connection(self._connection_changed)

    def close(self) -> None:
        """Do nothing: the bus is shared, and whoever opened it closes it."""

    def _received(self, key_expression: str, received: Received) -> None:
        self._subscribed[key_expression](received)
        self._wake()

    def _connection_changed(self, connected: bool) -> None:  # noqa: FBT001 - the bus calls it with one argument
        if self._on_connection is not None:
            self._on_connection(connected)
        self._wake()


def _nobody(_argument: object) -> None:
    """Take what comes for a client that is gone."""
