"""The message bus that services meet on: topics, requests, presence, connection.

Four small protocols, composed in `Bus`. `zenoh_bus.ZenohBus` is the real one, `memory_bus.MemoryBus` the
public fake; tests/contract holds both to what is written here.

Callbacks. Every `receive` callback may run on a thread of the bus, or on the caller's own thread when sender
and receiver share one bus. A callback therefore only enqueues: it never waits, never asks and reads the
result, never closes the bus. A callback that raises is counted in `Bus.callback_errors`, logged once for each
kind of failure, and keeps its subscription; a request whose callback raised is answered with the error reply
`CALLBACK_FAILED`.

Keys are concrete (`sfid/v1/s1/state`), key expressions may hold the wildcards `*` (one chunk), `$*` (part of
a chunk) and `**` (any number of chunks, none too). A wildcard does not match a chunk that begins with `@`. A
malformed key raises ValueError in the caller, on every bus.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

CALLBACK_FAILED: Final = b"the server failed on this request"
"""Payload of the error reply to a request whose callback raised."""


class BusError(Exception):
    """The bus cannot do what was asked; the message is one line: what is wrong, where, and the mend."""


@dataclass(frozen=True, slots=True)
class Received:
    """One message of a topic."""

    key: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Presence:
    """One change of who is there: `key` has been announced (present) or its last holder has gone."""

    key: str
    present: bool


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a request; `ok` is False for an error reply."""

    payload: bytes
    ok: bool = True


class Request(Protocol):
    """A question that waits for one answer.

    It may be answered from any thread, also long after the callback returned. The first answer counts and
    later ones are ignored; an answer after the asker's timeout is lost in silence. A request that is dropped
    (no reference left) tells the asker at once that there is no answer.
    """

    @property
    def key(self) -> str:
        """The concrete key that was asked."""

    @property
    def payload(self) -> bytes:
        """The body of the question, b"" when there was none."""

    def reply(self, payload: bytes) -> None:
        """Answer with `payload`."""

    def reply_error(self, payload: bytes) -> None:
        """Answer with an error reply."""


class Topics(Protocol):
    """Publish and subscribe: fast, and droppable."""

    def publish(self, key: str, payload: bytes) -> None:
        """Send `payload` to the present subscribers of `key`, without waiting for anyone.

        The messages of one sender arrive in order. They are lost in silence when a receiver is too slow,
        while the bus is not connected, and after close(); there is no history for late subscribers.
        """

    def subscribe(self, key_expression: str, receive: Callable[[Received], None]) -> None:
        """Call `receive` with every message on a matching key from now on, across reconnections."""


class Requests(Protocol):
    """Questions with at most one answer of each server."""

    def serve(
        self, key_expression: str, receive: Callable[[Request], None], *, shared: bool = False
    ) -> Callable[[], None]:
        """Call `receive` with every request on a matching key until the returned function is called.

        It serves across reconnections. Where several buses serve one key, one of them gets the request: the
        asker's own if it is among them. Those who serve it `shared` all get it, where nobody serves it alone:
        whoever knows the answer replies, and the others drop it. One bus serves a key alone once.
        """

    def ask(self, key: str, payload: bytes, receive: Callable[[Reply | None], None], timeout_ms: int) -> None:
        """Ask the server of `key` without waiting, and call `receive` exactly once.

        `receive` gets the reply, or None for no answer: nobody serves the key, the server went away or
        dropped the request, `timeout_ms` (> 0) passed, the bus is not connected, was disconnected or closed.
        None does not mean that the server did nothing: ask again with the same id. Of several servers who
        share the key the first reply counts, and it comes without waiting for the others.
        """

    def ask_all(
        self, key: str, payload: bytes, receive: Callable[[tuple[Reply, ...]], None], timeout_ms: int
    ) -> None:
        """Ask everybody who shares `key`, and call `receive` exactly once with what they replied.

        That is once each has replied or dropped the request, or `timeout_ms` has passed; empty as None of
        `ask`. Whoever serves the key alone gives the one reply.
        """


class PresenceBoard(Protocol):
    """Who is there, noticed at once when a process dies."""

    def announce(self, key: str) -> Callable[[], None]:
        """Be present at `key` until the returned function is called, the bus closes, or the process dies."""

    def watch(self, key_expression: str, receive: Callable[[Presence], None]) -> Callable[[], None]:
        """Call `receive` for everybody present now on a matching key, and with every change after.

        That ends when the returned function is called.

        Several holders of one key count as one presence. While the watcher itself is cut off, everybody is
        reported gone, and those who are still there are reported again after the reconnection.
        """


class Connection(Protocol):
    """Whether this bus reaches the others."""

    def connected(self) -> bool:
        """Whether the bus has a connection now; False after close()."""

    def on_connection(self, receive: Callable[[bool], None]) -> None:
        """Call `receive` with the present state, and then with every change."""


class Bus(Topics, Requests, PresenceBoard, Connection, Protocol):
    """All of the bus, and its end."""

    @property
    def callback_errors(self) -> int:
        """How many callbacks have raised so far."""

    def close(self) -> None:
        """Withdraw everything this bus declared and answer its open asks with None; twice is once.

        After close() publish does nothing, ask answers None, and declaring anything raises BusError.
        """
