"""The bus on Zenoh: a client of a router; the only module that imports zenoh."""

import atexit
import json
import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

import zenoh
from zenoh.handlers import Callback

from protocol.keys import router_key
from services.runtime.access import Access, Guard
from services.runtime.bus import CALLBACK_FAILED, BusError, Presence, Received, Reply, Request
from services.runtime.callback_guard import CallbackGuard
from services.runtime.key_expression import KeyIndex, checked_key, checked_key_expression
from services.runtime.known_keys import KnownKeys
from services.runtime.replies import EveryReply, FirstReply, OpenAsk
from services.runtime.zenoh_config import (
    LinkLimits,
    client_config,
    router_config,
    share_threads,
    split_endpoint,
)

__all__ = ["ZenohBus", "ZenohRouter", "client_config", "open_bus", "router_config"]

# What Zenoh itself puts into the error reply of a query whose time is up.
_TIMEOUT = b"Timeout"
_RETRY_S = 0.1
_LEAVE_S = 1.0
# Callbacks that wait for the interpreter's lock have not been seen yet by anybody: they get a moment.
_CALLBACKS_S = 0.01
_KNOCK_S = 0.2
D = TypeVar("D")
T = TypeVar("T")


class _Declaration(Protocol):
    """What can be withdrawn."""

    def undeclare(self) -> None:
        """Withdraw it."""


class ZenohBus:
    """A Bus (see bus.py) over one client session; opens it at once, BusError when no router answers."""

    def __init__(self, endpoint: str, limits: LinkLimits | None = None, access: Access | None = None) -> None:
        self._guard = CallbackGuard()
        self._lock = threading.RLock()
        self._closed = False
        self._connected = False
        self._watchers: list[Callable[[bool], None]] = []
        self._asks: set[OpenAsk] = set()
        self._alone, self._shared = KeyIndex(), KeyIndex()
        """What this bus serves."""
        self._inside: list[int] = []
        self._declared: dict[int, object] = {}
        """By identity: thousands are withdrawn one by one."""
        self._session = _open_session(client_config(endpoint, limits, access), lambda: _no_router(endpoint))
        self._known = KnownKeys(self._session.declare_keyexpr)
        # Without this a session left open at interpreter exit could call into a Python that is gone.
        atexit.register(self.close)
        info = self._session.info
        self._keep(info.declare_transport_events_listener(_direct(self._on_transport), history=True))

    @property
    def callback_errors(self) -> int:
        """See Bus."""
        return self._guard.errors

    def publish(self, key: str, payload: bytes) -> None:
        """See Topics."""
        checked_key(key)
        thread = threading.get_ident()
        self._inside.append(thread)  # before the look at `_closed`, so that `close` sees whoever gets past it
        try:
            if not self._closed:
                known = self._known.use(key)
                self._session.put(known, payload, congestion_control=zenoh.CongestionControl.DROP)
        except zenoh.ZError:
            if not self._closed:
                raise
        finally:
            self._inside.remove(thread)

    def subscribe(self, key_expression: str, receive: Callable[[Received], None]) -> None:
        """See Topics."""

        def on_sample(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                received = Received(str(sample.key_expr), sample.payload.to_bytes())
                self._guard.call("subscribe", receive, received)

        self._declare(key_expression, lambda key: self._session.declare_subscriber(key, _direct(on_sample)))

    def serve(
        self, key_expression: str, receive: Callable[[Request], None], *, shared: bool = False
    ) -> Callable[[], None]:
        """See Requests."""

        def on_query(query: zenoh.Query) -> None:
            request = _ZenohRequest(query)
            if not self._guard.call("serve", receive, request):
                request.reply_error(CALLBACK_FAILED)

        def declare(key: str) -> zenoh.Queryable[None]:
            # complete: of several servers of a key Zenoh picks one; without it every one gets every request.
            return self._session.declare_queryable(key, _direct(on_query), complete=not shared)

        queryable = self._declare(key_expression, declare)
        served = self._shared if shared else self._alone
        with self._lock:
            served.add(key_expression)

        def withdraw() -> None:
            with self._lock:
                if id(queryable) in self._declared:
                    served.remove(key_expression)
                    self._undeclare(queryable)

        return withdraw

    def ask(self, key: str, payload: bytes, receive: Callable[[Reply | None], None], timeout_ms: int) -> None:
        """See Requests."""
        self._ask(key, payload, FirstReply(self._guard, receive, self._asks.discard), timeout_ms)

    def ask_all(
        self, key: str, payload: bytes, receive: Callable[[tuple[Reply, ...]], None], timeout_ms: int
    ) -> None:
        """See Requests."""
        self._ask(key, payload, EveryReply(self._guard, receive, self._asks.discard), timeout_ms)

    def _ask(self, key: str, payload: bytes, asked: OpenAsk, timeout_ms: int) -> None:
        checked_key(key)
        if timeout_ms <= 0:
            message = f"timeout_ms = {timeout_ms}: an ask needs a positive timeout"
            raise ValueError(message)
        thread = threading.get_ident()
        self._inside.append(thread)
        try:
            self._get(key, payload, asked, timeout_ms)
        finally:
            self._inside.remove(thread)

    def _get(self, key: str, payload: bytes, asked: OpenAsk, timeout_ms: int) -> None:
        if self._closed:
            asked.end()
            return
        self._asks.add(asked)

        def on_reply(reply: zenoh.Reply) -> None:
            asked.took(_said(reply))

        try:
            self._session.get(
                self._known.use(key),
                Callback(on_reply, asked.end, indirect=False),
                payload=payload,
                timeout=timeout_ms / 1000,
                # The first reply is handed on at once instead of held back until the query has ended.
                consolidation=zenoh.ConsolidationMode.NONE,
                # Blocking would let one stuck asker hold up the server's link for 5 s; asks are repeated.
                # Not express: unbatched, a burst of 1000 asks of 100 B loses hundreds, batched none, and a
                # single round trip takes the same time.
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=self._where(key),
            )
        except zenoh.ZError:
            asked.end()

    def _where(self, key: str) -> zenoh.Locality:
        # Left to itself Zenoh would ask a server on this bus and one elsewhere, both.
        if key in self._alone:
            return zenoh.Locality.SESSION_LOCAL
        return zenoh.Locality.ANY if key in self._shared else zenoh.Locality.REMOTE

    def announce(self, key: str) -> Callable[[], None]:
        """See PresenceBoard."""
        token = self._declare(checked_key(key), self._session.liveliness().declare_token)
        return lambda: self._undeclare(token)

    def watch(self, key_expression: str, receive: Callable[[Presence], None]) -> Callable[[], None]:
        """See PresenceBoard."""

        def on_sample(sample: zenoh.Sample) -> None:
            presence = Presence(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)
            self._guard.call("watch", receive, presence)

        def declare(key: str) -> zenoh.Subscriber[None]:
            return self._session.liveliness().declare_subscriber(key, _direct(on_sample), history=True)

        watcher = self._declare(key_expression, declare)
        return lambda: self._undeclare(watcher)

    def _undeclare(self, declared: "_Declaration") -> None:
        with self._lock:
            if not self._closed and self._declared.pop(id(declared), None) is not None:
                declared.undeclare()

    def connected(self) -> bool:
        """See Connection."""
        return self._connected

    def on_connection(self, receive: Callable[[bool], None]) -> None:
        """See Connection."""
        with self._lock:
            self._watchers.append(receive)
            self._guard.call("on_connection", receive, self._connected)

    def close(self) -> None:
        """See Bus."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        atexit.unregister(self.close)
        self._session.close()
        for asked in tuple(self._asks):
            asked.end()
        self._set_connected(connected=False)
        self._await_leaving()

    def _await_leaving(self) -> None:
        """Wait for threads to come out of Zenoh: one in it while the interpreter ends aborts the process."""
        until, me, pause = time.monotonic() + _LEAVE_S, threading.get_ident(), threading.Event()
        while any(thread != me for thread in tuple(self._inside)) and time.monotonic() < until:
            pause.wait(0.001)  # not time.sleep: it fails where a faked clock jumps
        pause.wait(_CALLBACKS_S)

    def _declare(self, key_expression: str, declare: Callable[[str], D]) -> D:
        checked_key_expression(key_expression)
        try:
            declared = declare(key_expression)
        except zenoh.ZError as error:
            message = f"cannot declare {key_expression!r}: the bus is closed" if self._closed else str(error)
            raise BusError(message) from error
        self._keep(declared)
        return declared

    def _keep(self, declared: object) -> None:
        self._declared[id(declared)] = declared

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        self._set_connected(connected=event.kind == zenoh.SampleKind.PUT)

    def _set_connected(self, *, connected: bool) -> None:
        with self._lock:
            if connected == self._connected:
                return
            self._connected = connected
            for receive in self._watchers:
                self._guard.call("on_connection", receive, connected)


class _ZenohRequest:
    """A Request (see bus.py) on one Zenoh query."""

    def __init__(self, query: zenoh.Query) -> None:
        self.key = str(query.key_expr)
        self.payload = query.payload.to_bytes() if query.payload is not None else b""
        # A list, because pop() hands the query to one thread only, without a lock.
        self._unanswered = [query]

    def reply(self, payload: bytes) -> None:
        """See Request."""
        self._answer(lambda query: query.reply(self.key, payload))

    def reply_error(self, payload: bytes) -> None:
        """See Request."""
        self._answer(lambda query: query.reply_err(payload))

    def _answer(self, send: Callable[[zenoh.Query], None]) -> None:
        try:
            query = self._unanswered.pop()
        except IndexError:
            return
        try:
            send(query)
        except zenoh.ZError:
            return  # The session is closed: the asker has been told that there is no answer.
        finally:
            query.drop()


def _said(reply: zenoh.Reply) -> Reply | None:
    """Return a reply of the server; None for Zenoh's own word that the time is up."""
    if reply.ok is not None:
        return Reply(reply.ok.payload.to_bytes(), ok=True)
    payload = reply.err.payload.to_bytes() if reply.err is not None else _TIMEOUT
    return None if payload == _TIMEOUT else Reply(payload, ok=False)


class ZenohRouter:
    """A router at one endpoint, or BusError with `refusal`; it links with others as they come."""

    def __init__(
        self,
        listen: str,
        refusal: str,
        limits: LinkLimits | None = None,
        guard: Guard | None = None,
        connect: Sequence[str] = (),
    ) -> None:
        self._session = _open_session(router_config(listen, limits, guard, connect), lambda: refusal)
        self._port = f":{split_endpoint(listen)[2]}"
        here = router_key(str(self._session.zid()))
        self._here = self._session.declare_queryable(here, _direct(_say_yes))
        atexit.register(self.close)

    def neighbours(self, timeout_ms: int) -> dict[str, bool]:
        """Return the ids of routers it connected to, and whether each is found; waits so long for each.

        A link that breaks within 0.1 s of its coming leaves Zenoh's routers so that after its return, until
        the next break, nothing that is declared at one is known at the other. Whoever connects to this one as
        a router is left out: what they are found to be is in their hands.
        """
        info = self._session.info
        mine = {str(link.zid) for link in info.links() if not str(link.src).endswith(self._port)}
        return {zid: self._finds(zid, timeout_ms) for zid in mine.intersection(map(str, info.routers_zid()))}

    def _finds(self, zid: str, timeout_ms: int) -> bool:
        replies = self._session.get(router_key(zid), timeout=timeout_ms / 1000)
        return any(reply.ok is not None for reply in replies)

    def close(self) -> None:
        """Stop routing and free the endpoint; twice is once."""
        atexit.unregister(self.close)
        self._session.close()


def _say_yes(query: zenoh.Query) -> None:
    query.reply(query.key_expr, b"")


def open_bus(
    endpoint: str, timeout_ms: int, limits: LinkLimits | None = None, access: Access | None = None
) -> ZenohBus:
    """Return a bus that is connected to the router at `endpoint`, as whom `access` says.

    Tries for `timeout_ms` (0: once), then raises BusError. Ctrl-C interrupts the waiting.
    """
    split_endpoint(endpoint)
    deadline_s = time.monotonic() + timeout_ms / 1000
    while True:
        try:
            return ZenohBus(endpoint, limits, access)
        except BusError:
            remaining_s = deadline_s - time.monotonic()
            if remaining_s <= 0:
                raise
            time.sleep(min(_RETRY_S, remaining_s))


def _no_router(endpoint: str) -> str:
    _, host, port = split_endpoint(endpoint)
    try:
        socket.create_connection((host, port), _KNOCK_S).close()
    except OSError:
        return f"no router at {endpoint}: start one with `sfid router` or pass --connect"
    return f"no router at {endpoint} lets this program in: it hangs, or asks for another login: pass --access"


def _open_session(config: Mapping[str, Any], refusal: Callable[[], str]) -> zenoh.Session:
    share_threads()
    try:
        return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        raise BusError(refusal()) from error


def _direct(callback: Callable[[T], None]) -> "Callback[T]":
    # Zenoh's default gives each declaration a non-daemon thread, which hangs the interpreter's exit.
    return Callback(callback, indirect=False)
