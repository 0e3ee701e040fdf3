"""The gateway service: one loop over browsers and bus."""

import asyncio
import json
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from protocol.keys import Keys
from services.gateway.config import GatewayConfig, GatewayError, Place, place_of
from services.gateway.house import House
from services.gateway.page import Page
from services.gateway.server import Reception, open_server
from services.runtime.bus import Bus
from services.runtime.clock import Clock, SystemClock
from services.runtime.register import Register
from services.runtime.secret import load_secrets
from services.runtime.status import StatusDesk
from services.screens import Flow, TeachOnly

log = logging.getLogger("sfid.gateway")

TICK_S = 0.05
STATUS_S = 0.5
DRAIN_S = 3.0
STATUS_NAME = "status.json"


class Inbox:
    """Calls handed over to the loop from threads of the bus, one waking for a whole batch."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._calls: deque[tuple[Callable[[Any], None], Any]] = deque()
        self._woken = False

    def post(self, handle: Callable[[Any], None], argument: Any) -> None:  # noqa: ANN401 - its handler knows
        """Call `handle` on the loop, soon."""
        self._calls.append((handle, argument))
        if not self._woken and not self._loop.is_closed():
            self._woken = True
            self._loop.call_soon_threadsafe(self._drain)

    def _drain(self) -> None:
        self._woken = False
        while self._calls:
            handle, argument = self._calls.popleft()
            try:
                handle(argument)
            except Exception:  # one message that fails must not hold up those behind it
                log.exception("a message from the bus could not be handled")


def run(
    config: GatewayConfig,
    bus: Bus,
    ready: Callable[[str], None],
    stop: threading.Event,
    flow: Flow | None = None,
    clock: Clock | None = None,
) -> None:
    """Serve the page until `stop` is set; `ready` is called with its address once it can be opened.

    Args: flow: what people see around teaching; without one they teach the session of their token.
    Raises: GatewayError when the address cannot be had or would be open to a network.
    """
    place = place_of(config)
    gateway = _Gateway(config, place, bus, flow or TeachOnly(), clock or SystemClock())
    asyncio.run(gateway.run(ready, stop))


class _Gateway:
    def __init__(self, config: GatewayConfig, place: Place, bus: Bus, flow: Flow, clock: Clock) -> None:
        self._config, self._place, self._bus, self._flow, self._clock = config, place, bus, flow, clock
        self._secrets = load_secrets(config.folder)
        self._register = Register(config.folder)
        self._logged: dict[str, int] = {}

    async def run(self, ready: Callable[[str], None], stop: threading.Event) -> None:
        config, place = self._config, self._place
        inbox = Inbox(asyncio.get_running_loop())
        house = House(
            self._bus, Keys(config.deployment), self._secrets, self._register,
            self._flow, config.limits, self._clock, inbox.post,
        )  # fmt: skip
        reception = Reception(house, Page(tls=place.tls is not None), config.limits)
        try:
            server = await open_server(reception, place, config.limits)
        except OSError as error:
            what = error.strerror or str(error)
            message = (
                f"cannot listen at {config.listen}: {what}: stop the other program or pass another --listen"
            )
            raise GatewayError(message) from None
        address = place.address(next(iter(server.sockets)).getsockname()[1])
        reception.meet(address)
        self._serve_status(house, inbox)
        self._write_status(address, house)
        ready(f"teach in a browser at {address}, invite with `sfid invite`")
        try:
            await self._attend(house, address, stop)
        finally:
            await self._close(house, server)
            self._write_status(address, house)

    def _serve_status(self, house: House, inbox: Inbox) -> None:
        desk = StatusDesk("gateway", "0", self._clock, house.facts)
        keys = Keys(self._config.deployment)
        self._bus.serve(keys.status("gateway", "0"), lambda request: inbox.post(desk.reply, request))
        self._bus.announce(keys.service("gateway", "0"))

    async def _attend(self, house: House, address: str, stop: threading.Event) -> None:
        written_s = time.monotonic()
        while not stop.is_set():
            await asyncio.sleep(TICK_S)
            house.tick()
            if time.monotonic() - written_s >= STATUS_S:
                written_s = time.monotonic()
                self._write_status(address, house)
                self._log_refusals(house)

    async def _close(self, house: House, server: Any) -> None:  # noqa: ANN401 - a websockets Server
        """Take in nothing more, and let answers on their way come home."""
        server.close(code=1012, reason="the gateway is restarting")
        until = time.monotonic() + DRAIN_S
        while house.answers_open and time.monotonic() < until:
            await asyncio.sleep(TICK_S)
            house.tick()
        await server.wait_closed()

    def _write_status(self, address: str, house: House) -> None:
        status = {"url": address, "at_s": int(self._clock.wall_ns() // 1_000_000_000), **house.figures()}
        path = self._config.folder / STATUS_NAME
        part = path.with_suffix(".part")
        try:
            part.write_text(json.dumps(status) + "\n")
            part.replace(path)
        except OSError as error:
            log.warning("%s: %s: the status could not be written", path, error.strerror or error)

    def _log_refusals(self, house: House) -> None:
        refused = dict(house.counters.refused)
        if refused != self._logged:
            self._logged = refused
            log.info("refused so far: %s", json.dumps(refused, sort_keys=True))


def read_status(data_dir: Path) -> dict[str, Any]:
    """Return what a gateway last wrote about itself. Raises GatewayError when there is nothing to read."""
    path = GatewayConfig(data_dir).folder / STATUS_NAME
    try:
        status: dict[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError):
        raise GatewayError(f"{path}: no gateway has run here: start one with `sfid up --gateway`") from None
    return status
