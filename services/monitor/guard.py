"""Stands between a viewer and our server, so that no viewer can hold the server up.

The SDK's server sends to all viewers at the pace of the slowest: once one is a thousand messages behind,
everybody's picture stands still. So the guard takes from the server whatever it sends, at once, keeps it for
the viewer, and cuts a viewer who takes nothing for ten seconds, or who falls too far behind. Memory is
bounded: by the number of viewers, by what each has waiting, and by what all have waiting together.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import Counter
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

READ_BYTES = 1 << 18
TURN_S = 0.005
"""What a server sends goes to its viewers one so much later than the other: ten at once are felt by who
teaches on the same machine, one after another is not."""
AT_ONCE_BYTES = 1 << 16
"""So much goes on without waiting for its turn: it is the past of a viewer who has just come, no picture."""
START_TIMEOUT_S = 5.0
TOO_FAR_BEHIND = "is too far behind"

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Limits:
    """How much patience there is with viewers."""

    stalled_s: float = 10.0
    """A viewer that has bytes waiting and takes none for so long is cut."""
    silent_s: float = 5.0
    """Whoever has come and says nothing for so long is no viewer, and is cut."""
    look_s: float = 1.0
    connections_max: int = 64
    """A viewer has one to each server."""
    waiting_max: int = 192 << 20
    """Bytes that wait for one viewer: more than both histories, which a late viewer gets at once."""
    all_waiting_max: int = 256 << 20


class _Side(asyncio.BufferedProtocol):
    """One end of a viewer's way to the server, or of the way back; all of them read into the same bytes."""

    transport: asyncio.Transport

    def __init__(self, scratch: memoryview) -> None:
        self._scratch = scratch

    def get_buffer(self, sizehint: int) -> memoryview:  # noqa: ARG002 - the interface
        """Return where the next bytes are read to; they are passed on before anything else is read."""
        return self._scratch


class _Viewer(_Side):
    """A viewer's connection; `sent` is what its socket had taken when it was looked at last."""

    def __init__(self, guard: Guard, upstream: int, scratch: memoryview) -> None:
        super().__init__(scratch)
        self.server: _Server | None = None
        self.upstream = upstream
        self.turn = 0
        """Place in the order in which viewers of a server are sent the same; 0 is the first."""
        self.speaks = False
        self.given = self.sent = 0
        self.moved_s = 0.0
        self._kept: list[bytes] = []
        self._kept_bytes = 0
        self._guard = guard

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        self.transport.pause_reading()
        self._guard.admit(self)

    def buffer_updated(self, nbytes: int) -> None:
        self.speaks = True
        if self.server is not None:
            self.server.transport.write(bytes(self._scratch[:nbytes]))

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - the interface
        self._guard.dismiss(self)
        if self.server is not None:
            self.server.transport.abort()

    def take(self, data: bytes) -> None:
        """Keep what the server sends until the viewer takes it: its slowness is never handed on."""
        if not self._kept:
            self._guard.call_at_turn(self.turn, self.send_kept)
        self._kept.append(data)
        self._kept_bytes += len(data)
        self.given += len(data)
        if self._kept_bytes >= AT_ONCE_BYTES:
            self.send_kept()
        self._guard.look_at(self)

    def send_kept(self) -> None:
        """Send what was kept for this viewer's turn."""
        data = b"".join(self._kept)
        self._kept.clear()
        self._kept_bytes = 0
        if data and not self.transport.is_closing():
            self.transport.write(data)

    def waiting(self) -> int:
        """Return how many bytes wait for the viewer."""
        return self._kept_bytes + self.transport.get_write_buffer_size()


class _Server(_Side):
    """The connection to the server on behalf of one viewer."""

    def __init__(self, viewer: _Viewer, scratch: memoryview) -> None:
        super().__init__(scratch)
        self._viewer = viewer

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        if self._viewer.transport.is_closing():  # it has not waited
            self.transport.abort()
            return
        self._viewer.server = self
        self._viewer.transport.resume_reading()

    def buffer_updated(self, nbytes: int) -> None:
        self._viewer.take(bytes(self._scratch[:nbytes]))

    def pause_writing(self) -> None:
        self._viewer.transport.pause_reading()

    def resume_writing(self) -> None:
        self._viewer.transport.resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - the interface
        self._viewer.send_kept()
        self._viewer.transport.close()  # once it has had the rest


def free_turn(taken: set[int]) -> int:
    """Return the first turn that nobody has."""
    return min(set(range(len(taken) + 1)) - taken)


class Guard:
    """Listens where viewers come, and passes each on to the server; one thread for all of them."""

    def __init__(
        self, pairs: list[tuple[int, int]], bind: str, host: str, limits: Limits | None = None
    ) -> None:
        """Listen on the first port of each pair for the server at the second; raises OSError.

        Args: bind: address that viewers reach; host: address of the servers.
        """
        self.cut = 0
        """Connections that were cut because they did not keep up, or said nothing."""
        self._viewers: set[_Viewer] = set()
        self._host = host
        self._limits = limits or Limits()
        self._scratch = memoryview(bytearray(READ_BYTES))
        self._loop = asyncio.new_event_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._servers: list[asyncio.Server] = []
        self._thread = threading.Thread(target=self._run, name="monitor-guard", daemon=True)
        self._thread.start()
        opening = asyncio.run_coroutine_threadsafe(self._open(pairs, bind), self._loop)
        try:
            opening.result(START_TIMEOUT_S)
        except OSError:
            self.close()
            raise

    @property
    def viewers(self) -> int:
        """How many viewers are being shown something: the most that a server has."""
        shown = Counter(viewer.upstream for viewer in self._viewers.copy() if viewer.given)
        return max(shown.values(), default=0)

    def close(self) -> None:
        """Cut everybody and end."""
        if self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._end(), self._loop)
            self._thread.join(START_TIMEOUT_S)

    def admit(self, viewer: _Viewer) -> None:
        """Lead a viewer to the server, unless there are too many."""
        if len(self._viewers) >= self._limits.connections_max:
            _LOG.warning("a viewer is turned away: %d connections are the most", self._limits.connections_max)
            viewer.transport.abort()
            return
        viewer.moved_s = self._loop.time()
        viewer.turn = free_turn({one.turn for one in self._viewers if one.upstream == viewer.upstream})
        self._viewers.add(viewer)
        self._start(self._lead(viewer))

    def dismiss(self, viewer: _Viewer) -> None:
        """Note that a viewer is gone."""
        self._viewers.discard(viewer)

    def call_at_turn(self, turn: int, send: Callable[[], None]) -> None:
        """Have a viewer sent what came, when it is its turn."""
        self._loop.call_later(turn * TURN_S, send)

    def look_at(self, viewer: _Viewer) -> None:
        """Cut a viewer for whom too much waits."""
        if viewer.waiting() > self._limits.waiting_max:
            self._drop(viewer, TOO_FAR_BEHIND)

    def _run(self) -> None:
        try:
            self._loop.run_forever()
        finally:
            self._loop.close()

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _open(self, pairs: list[tuple[int, int]], bind: str) -> None:
        for listen, upstream in pairs:
            viewer = partial(_Viewer, self, upstream, self._scratch)
            self._servers.append(await self._loop.create_server(viewer, bind, listen))
        self._start(self._look())

    async def _lead(self, viewer: _Viewer) -> None:
        server = partial(_Server, viewer, self._scratch)
        try:
            await self._loop.create_connection(server, self._host, viewer.upstream)
        except OSError as error:
            _LOG.warning("a viewer cannot be served: %s", error)
            viewer.transport.abort()

    async def _end(self) -> None:
        for server in self._servers:
            server.close()
        for viewer in list(self._viewers):
            viewer.transport.abort()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.sleep(0)  # what was cut says so
        self._loop.call_soon(self._loop.stop)

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(self._limits.look_s)
            self._cut_who_stalls(self._loop.time())

    def _cut_who_stalls(self, now_s: float) -> None:
        for viewer in list(self._viewers):
            sent = viewer.given - viewer.waiting()
            if not viewer.speaks:
                if now_s - viewer.moved_s > self._limits.silent_s:
                    self._drop(viewer, f"says nothing for {self._limits.silent_s:.0f} s")
            elif sent != viewer.sent or not viewer.waiting():
                viewer.sent, viewer.moved_s = sent, now_s
            elif now_s - viewer.moved_s > self._limits.stalled_s:
                self._drop(viewer, f"takes nothing for {self._limits.stalled_s:.0f} s")
        while sum(viewer.waiting() for viewer in self._viewers) > self._limits.all_waiting_max:
            self._drop(max(self._viewers, key=_Viewer.waiting), TOO_FAR_BEHIND)

    def _drop(self, viewer: _Viewer, why: str) -> None:
        self.cut += 1
        _LOG.warning("a viewer that %s is cut: open the address again", why)
        self._viewers.discard(viewer)
        viewer.transport.abort()
