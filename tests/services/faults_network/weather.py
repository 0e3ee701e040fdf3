"""A TCP proxy that is slow, cuts, stalls and spoils what passes, by a seed: bad weather on one link."""

import asyncio
import random
import threading
from collections.abc import Coroutine
from dataclasses import dataclass
from typing import Any, Self

CHUNK_BYTES = 16_384


@dataclass
class Weather:
    """What happens on the link now; may be changed at any moment."""

    delay_ms: float = 0.0
    jitter_ms: float = 0.0
    """Added to the delay, drawn anew for each chunk; order is kept, as TCP does."""
    flip_share: float = 0.0
    """Share of the chunks in which one bit is turned over."""
    open_up: bool = True
    """Whether bytes pass from the client to the server; if not they wait, as they do in a partition."""
    open_down: bool = True


class Proxy:
    """Listens on a port of its own and passes bytes to `port` of this machine, on a thread of its own."""

    def __init__(self, port: int, seed: int = 0) -> None:
        self.weather = Weather()
        self.connections = self.flips = self.cuts = 0
        self.port = 0
        self._to = port
        self._chance = random.Random(seed)
        self._loop = asyncio.new_event_loop()
        self._links: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._thread = threading.Thread(target=self._loop.run_forever, name="weather", daemon=True)

    @property
    def endpoint(self) -> str:
        """Where to connect to instead of to the server."""
        return f"tcp/127.0.0.1:{self.port}"

    def __enter__(self) -> Self:
        self._thread.start()
        self._call(self._listen())
        return self

    def __exit__(self, *_: object) -> None:
        self._call(self._close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5)
        self._loop.close()

    def cut(self) -> None:
        """End every connection at once, without a word."""
        self._call(self._cut())

    def _call(self, coroutine: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(10)

    async def _listen(self) -> None:
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", 0, limit=CHUNK_BYTES)
        self.port = self._server.sockets[0].getsockname()[1]

    async def _close(self) -> None:
        self._server.close()
        await self._cut()

    async def _cut(self) -> None:
        self.cuts += len(self._links) // 2
        for writer in list(self._links):
            writer.transport.abort()
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._links.clear()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        self.connections += 1
        try:
            there_reader, there = await asyncio.open_connection("127.0.0.1", self._to, limit=CHUNK_BYTES)
        except OSError:
            writer.transport.abort()
            self._tasks.discard(task)
            return
        self._links |= {writer, there}
        try:
            await asyncio.gather(
                self._carry(reader, there, upwards=True), self._carry(there_reader, writer, upwards=False)
            )
        except (OSError, asyncio.CancelledError):
            pass
        finally:
            self._tasks.discard(task)
            for each in (writer, there):
                self._links.discard(each)
                each.transport.abort()

    async def _carry(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, upwards: bool
    ) -> None:
        loop, free_at = self._loop, 0.0
        while chunk := await reader.read(CHUNK_BYTES):
            weather = self.weather
            wait_s = (weather.delay_ms + self._chance.random() * weather.jitter_ms) / 1000
            free_at = max(free_at, loop.time() + wait_s)
            await self._after(free_at - loop.time())
            await self._opened(upwards=upwards)
            writer.write(self._spoilt(chunk))
            await writer.drain()
        raise ConnectionResetError

    async def _opened(self, *, upwards: bool) -> None:
        """Return when bytes may pass: a test changes the weather on another thread, so it is looked at."""
        while not (self.weather.open_up if upwards else self.weather.open_down):
            await self._after(0.005)

    async def _after(self, seconds: float) -> None:
        """Let so much time pass: this is the delay of the link, not a test that waits."""
        passed = self._loop.create_future()
        self._loop.call_later(max(0.0, seconds), passed.set_result, None)
        await passed

    def _spoilt(self, chunk: bytes) -> bytes:
        if not self.weather.flip_share or self._chance.random() >= self.weather.flip_share:
            return chunk
        self.flips += 1
        spoilt = bytearray(chunk)
        spoilt[self._chance.randrange(len(spoilt))] ^= 1 << self._chance.randrange(8)
        return bytes(spoilt)
