"""The gateway's socket: the page and its websocket on one port, with every limit and check on the way in."""

import asyncio
import logging
import socket
from collections import Counter
from functools import partial
from http import HTTPStatus
from typing import Any, cast

from websockets.asyncio.server import Server, ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from services.gateway.config import Limits, Place
from services.gateway.frames import Frame, FrameError, Hello, read, written
from services.gateway.house import House
from services.gateway.limits import Counters, Reason
from services.gateway.page import SOCKET_PATH, Page
from services.gateway.visitor import BAD_FRAME, Visitor

log = logging.getLogger("sfid.gateway")
_quiet = logging.getLogger("sfid.gateway.websockets")
# Its debug lines hold whole frames, the first of which has the token; its errors are those of strangers.
_quiet.setLevel(logging.CRITICAL)

MALFORMED_MAX = 10
"""Frames of one connection that cannot be read; then it is closed."""
TOO_LARGE_CODE = 1009
SEND_BUFFER_BYTES = 65_536


class Crowd:
    """How many connections are open, in all and by address."""

    def __init__(self, limits: Limits, counters: Counters) -> None:
        self.limits, self.counters = limits, counters
        self.open = 0
        self.by_address: Counter[str] = Counter()

    def enter(self, address: str) -> bool:
        """Count a connection in; tell whether there is room for it."""
        self.open += 1
        self.by_address[address] += 1
        limits = self.limits
        if (
            self.open <= limits.connections_max
            and self.by_address[address] <= limits.connections_per_address_max
        ):
            return True
        self.counters.refuse(Reason.CROWDED)
        return False

    def go(self, address: str) -> None:
        """Count a connection out."""
        self.open -= 1
        self.by_address[address] -= 1
        if not self.by_address[address]:
            del self.by_address[address]


class Door(ServerConnection):
    """A connection that is counted from first to last, and ended at once when there are too many."""

    def __init__(self, crowd: Crowd, *args: Any, **options: Any) -> None:  # noqa: ANN401 - as the base class has it
        super().__init__(*args, **options)
        self._crowd = crowd
        self._address = ""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See asyncio.Protocol."""
        self._address = str((transport.get_extra_info("peername") or ("",))[0])
        # Left to itself the system keeps megabytes for each browser that does not read.
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        super().connection_made(transport)
        if not self._crowd.enter(self._address):
            self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """See asyncio.Protocol."""
        self._crowd.go(self._address)
        super().connection_lost(exc)


class SocketLine:
    """A Line (see visitor.py) over one websocket; a browser that does not read is let go."""

    def __init__(self, browser: ServerConnection, limits: Limits, counters: Counters) -> None:
        self._socket, self._limits, self._counters = browser, limits, counters
        self._closing: asyncio.Task[None] | None = None

    def send(self, text: str) -> None:
        """See Line."""
        transport = self._socket.transport
        if self._closing is not None or transport.is_closing():
            return
        if transport.get_write_buffer_size() > self._limits.buffered_bytes_max:
            self._counters.refuse(Reason.SLOW_READER)
            transport.abort()
            return
        broadcast((self._socket,), text)

    async def closed(self) -> None:
        """Wait until a closing that was begun has come to its end, with its code."""
        if self._closing is not None:
            await self._closing

    def close(self, code: int, reason: str) -> None:
        """See Line."""
        if self._closing is None:
            self._closing = asyncio.get_running_loop().create_task(self._socket.close(code, reason))


class Reception:
    """Takes in requests and frames, and hands what is in order to the house."""

    def __init__(self, house: House, page: Page, limits: Limits) -> None:
        self._house, self._page, self._limits = house, page, limits
        self._counters = house.counters
        self.crowd = Crowd(limits, house.counters)
        self._origin = self._host = ""

    def meet(self, address: str) -> None:
        """Fix the page's address, once the port is known."""
        self._origin, self._host = address, address.partition("://")[2]
        self._page.meet(address)

    def on_request(self, _socket: ServerConnection, request: Request) -> Response | None:
        """Answer a request for the page; None lets a websocket through."""
        if request.headers.get_all("Host") != [self._host]:
            return self._refuse(Reason.HOST, HTTPStatus.MISDIRECTED_REQUEST)
        if request.path == SOCKET_PATH:
            if request.headers.get_all("Origin") != [self._origin]:
                return self._refuse(Reason.ORIGIN, HTTPStatus.FORBIDDEN)
            return None
        found = self._page.file(request)
        return found if found is not None else self._refuse(Reason.PATH, HTTPStatus.NOT_FOUND)

    def _refuse(self, reason: Reason, status: HTTPStatus) -> Response:
        self._counters.refuse(reason)
        return self._page.refusal(status)

    async def on_socket(self, browser: ServerConnection) -> None:
        """Serve one websocket to its end."""
        line = SocketLine(browser, self._limits, self._counters)
        visitor: Visitor | None = None
        try:
            visitor = await self._greet(browser, line)
            if visitor is not None:
                await self._listen(browser, line, visitor)
        except ConnectionClosed as closed:
            if closed.sent is not None and closed.sent.code == TOO_LARGE_CODE:
                self._counters.refuse(Reason.TOO_LARGE)
        except Exception:  # of one connection: everybody else goes on
            self._counters.refuse(Reason.FAULT)
            log.exception("a connection failed")
        finally:
            if visitor is not None:
                visitor.depart(line, self._house.now_ns())
            await line.closed()

    async def _greet(self, browser: ServerConnection, line: SocketLine) -> Visitor | None:
        try:
            async with asyncio.timeout(self._limits.hello_timeout_s):
                text = await browser.recv()
        except TimeoutError:
            self._counters.refuse(Reason.NO_HELLO)
            line.close(BAD_FRAME, "no hello")
            return None
        frame = self._read(text, line)
        if isinstance(frame, Hello):
            return self._house.admit(frame, line)
        if frame is not None:
            self._counters.refuse(Reason.MALFORMED)
        line.close(BAD_FRAME, "no hello")
        return None

    async def _listen(self, browser: ServerConnection, line: SocketLine, visitor: Visitor) -> None:
        loop = asyncio.get_running_loop()
        malformed = 0
        async for text in browser:
            if visitor.line is not line or not visitor.admit(loop.time()):
                continue
            frame = self._read(text, line)
            if frame is not None:
                self._serve(visitor, frame)
                continue
            malformed += 1
            if malformed == MALFORMED_MAX:
                line.close(BAD_FRAME, "malformed frames")

    def _serve(self, visitor: Visitor, frame: Frame) -> None:
        try:
            visitor.receive(frame)
        except Exception:  # whatever it is, the next frame is another one
            self._counters.refuse(Reason.FAULT)
            log.exception("a frame of %s could not be served", visitor.person.pseudonym)

    def _read(self, text: str | bytes, line: SocketLine) -> Frame | None:
        if isinstance(text, bytes):
            self._counters.refuse(Reason.BINARY)
            return None
        try:
            return read(text)
        except FrameError:
            self._counters.refuse(Reason.MALFORMED)
            line.send(
                written("refused", reason="malformed", text="the page sent what cannot be read", final=False)
            )
            return None


async def open_server(reception: Reception, place: Place, limits: Limits) -> Server:
    """Return the listening server. Raises OSError when the address cannot be had."""
    return await serve(
        reception.on_socket,
        place.host,
        place.port,
        ssl=place.tls,
        process_request=reception.on_request,
        create_connection=cast("type[ServerConnection]", partial(Door, reception.crowd)),
        compression=None,
        open_timeout=limits.open_timeout_s,
        ping_interval=limits.ping_s,
        ping_timeout=limits.ping_s,
        close_timeout=2,
        max_size=limits.frame_bytes_max,
        max_queue=limits.frames_queued_max,
        server_header=None,
        logger=_quiet,
    )
