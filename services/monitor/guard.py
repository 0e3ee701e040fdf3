"""Stands between a viewer and our server, so that no viewer can hold the server up.

The SDK's server sends to all viewers at the pace of the slowest: once one is a thousand messages behind,
everybody's picture stands still. So the guard takes from the server whatever it sends, at once, keeps it for
the viewer, and cuts a viewer who takes nothing for ten seconds, or who falls too far behind. Memory is
bounded: by the number of viewers, by what each has waiting, and by what all have waiting together.
"""

import asyncio
import contextlib
import logging
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

READ_BYTES = 1 << 18
START_TIMEOUT_S = 5.0

Receive = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Limits:
    """How much patience there is with viewers."""

    stalled_s: float = 10.0
    """A viewer that has bytes waiting and takes none for so long is cut."""
    look_s: float = 1.0
    viewers_max: int = 32
    waiting_max: int = 192 << 20
    """Bytes that wait for one viewer: more than both histories, which a late viewer gets at once."""
    all_waiting_max: int = 256 << 20


@dataclass(eq=False, slots=True)
class _Viewer:
    """One connection; `sent` is what its socket has taken."""

    writer: asyncio.StreamWriter
    given: int = 0
    sent: int = 0
    moved_s: float = 0.0
    tasks: list[asyncio.Task[None]] = field(default_factory=list)

    def waiting(self) -> int:
        return self.writer.transport.get_write_buffer_size()


class Guard:
    """Listens where viewers come, and passes each on to the server; one thread for all of them."""

    def __init__(
        self, pairs: list[tuple[int, int]], bind: str, host: str, limits: Limits | None = None
    ) -> None:
        """Listen on the first port of each pair for the server at the second; raises OSError.

        Args: bind: address that viewers reach; host: address of the servers.
        """
        self.cut = 0
        """Viewers that were cut because they did not keep up."""
        self._viewers: set[_Viewer] = set()
        self._host = host
        self._limits = limits or Limits()
        self._loop = asyncio.new_event_loop()
        self._servers: list[asyncio.Server] = []
        self._thread = threading.Thread(target=self._run, name="monitor-guard", daemon=True)
        self._thread.start()
        opening = asyncio.run_coroutine_threadsafe(self._open(pairs, bind), self._loop)
        try:
            opening.result(START_TIMEOUT_S)
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        """Cut everybody and end."""
        if self._thread.is_alive():
            asyncio.run_coroutine_threadsafe(self._end(), self._loop)
            self._thread.join(START_TIMEOUT_S)

    def _run(self) -> None:
        try:
            self._loop.run_forever()
        finally:
            self._loop.close()

    async def _open(self, pairs: list[tuple[int, int]], bind: str) -> None:
        for listen, upstream in pairs:
            receive = self._receiver(upstream)
            self._servers.append(await asyncio.start_server(receive, bind, listen, limit=READ_BYTES))
        self._watch = self._loop.create_task(self._look())

    def _receiver(self, upstream: int) -> Receive:
        async def receive(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            # Cancelled is how we end; asyncio's own callback would call it a fault.
            with contextlib.suppress(asyncio.CancelledError):
                await self._receive(upstream, reader, writer)

        return receive

    async def _end(self) -> None:
        for server in self._servers:
            server.close()
        for viewer in self._viewers:
            viewer.writer.transport.abort()
        tasks = asyncio.all_tasks(self._loop) - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._loop.call_soon(self._loop.stop)

    async def _receive(
        self, upstream: int, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        if len(self._viewers) >= self._limits.viewers_max:
            _LOG.warning("a viewer is turned away: %d connections are the most", self._limits.viewers_max)
            writer.transport.abort()
            return
        viewer = _Viewer(writer, moved_s=self._loop.time())
        self._viewers.add(viewer)
        up: asyncio.StreamWriter | None = None
        try:
            down, up = await asyncio.open_connection(self._host, upstream, limit=READ_BYTES)
            viewer.tasks = [
                self._loop.create_task(self._pass_up(reader, up)),
                self._loop.create_task(self._pass_down(down, viewer)),
            ]
            await asyncio.wait(viewer.tasks, return_when=asyncio.FIRST_COMPLETED)
        except OSError as error:
            _LOG.warning("a viewer cannot be served: %s", error)
        finally:
            for task in viewer.tasks:
                task.cancel()
            self._viewers.discard(viewer)
            writer.transport.abort()
            if up is not None:
                up.transport.abort()

    @staticmethod
    async def _pass_up(reader: asyncio.StreamReader, up: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(READ_BYTES):
                up.write(data)
                await up.drain()

    async def _pass_down(self, down: asyncio.StreamReader, viewer: _Viewer) -> None:
        with contextlib.suppress(OSError):
            while data := await down.read(READ_BYTES):
                # No `drain`: that would hand the viewer's slowness on to the server.
                viewer.writer.write(data)
                viewer.given += len(data)
                if viewer.waiting() > self._limits.waiting_max:
                    return
            # The server has ended: let the viewer have the rest.
            await asyncio.wait_for(viewer.writer.drain(), self._limits.stalled_s)

    async def _look(self) -> None:
        while True:
            await asyncio.sleep(self._limits.look_s)
            self._cut_who_stalls(self._loop.time())

    def _cut_who_stalls(self, now_s: float) -> None:
        for viewer in list(self._viewers):
            sent = viewer.given - viewer.waiting()
            if sent != viewer.sent or not viewer.waiting():
                viewer.sent, viewer.moved_s = sent, now_s
            elif now_s - viewer.moved_s > self._limits.stalled_s:
                self._drop(viewer, f"takes nothing for {self._limits.stalled_s:.0f} s")
        while sum(viewer.waiting() for viewer in self._viewers) > self._limits.all_waiting_max:
            self._drop(max(self._viewers, key=_Viewer.waiting), "is too far behind")

    def _drop(self, viewer: _Viewer, why: str) -> None:
        self.cut += 1
        _LOG.warning("a viewer that %s is cut: open the address again", why)
        self._viewers.discard(viewer)
        viewer.writer.transport.abort()
        for task in viewer.tasks:
            task.cancel()
