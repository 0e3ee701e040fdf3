"""How a command waits: for its router long, but never longer than it is wanted."""

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from services.cli.failure import OK
from services.cli.options import SERVICE_CONNECT_TIMEOUT_MS
from services.runtime.bus import Bus, BusError
from services.runtime.zenoh_config import split_endpoint

SLICE_MS = 500
"""How soon a stop is noticed while the router is not there."""


def service_bus(endpoint: str, stop: threading.Event) -> Bus:
    """Return a bus connected to the router at `endpoint`; leave with exit code 0 when told to stop before.

    Raises: BusError when the endpoint is malformed, or no router came within SERVICE_CONNECT_TIMEOUT_MS.
    """
    from services.runtime.zenoh_bus import open_bus

    split_endpoint(endpoint)
    until = time.monotonic() + SERVICE_CONNECT_TIMEOUT_MS / 1000
    while True:
        try:
            return open_bus(endpoint, SLICE_MS)
        except BusError:
            if stop.is_set():
                raise typer.Exit(OK) from None
            if time.monotonic() >= until:
                raise


@contextmanager
def stoppable() -> Iterator[None]:
    """Let SIGTERM end the block as Ctrl-C does, so that everything drains."""

    def interrupt(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
