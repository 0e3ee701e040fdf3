"""How a command waits: for its router long, but never longer than it is wanted."""

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from services.cli.shared.failure import OK
from services.cli.shared.options import SERVICE_CONNECT_TIMEOUT_MS
from services.runtime.access import CertificateError, CleartextError, access_for
from services.runtime.bus import Bus, BusError
from services.runtime.secret import SecretError
from services.runtime.signals import Stop, StopSignals
from services.runtime.zenoh_bus import ZenohBus, open_bus
from services.runtime.zenoh_config import split_endpoint
from services.topology import Role

log = logging.getLogger("sfid.waiting")
TOLD_AFTER_S = 2.0
"""So long is waited in silence: services that start side by side seldom need more."""
SLICE_MS = 500
"""How soon a stop is noticed while the router is not there."""


def connected_bus(endpoint: str, role: Role, access: Path | None, timeout_ms: int) -> ZenohBus:
    """Return a bus connected as `role` to the router at `endpoint`, which is tried for `timeout_ms`.

    Args: access: directory of the login; None: where a router of this person on this machine has told.
    Raises: BusError, SecretError.
    """
    return open_bus(endpoint, timeout_ms, access=access_for(endpoint, role.value, access))


class Told:
    """Says once of each thing what is waited for, when that takes longer than TOLD_AFTER_S.

    Args: endpoint: of the router; begun_s: when the waiting began, on the clock of `note`.
    """

    def __init__(self, endpoint: str, begun_s: float) -> None:
        self._endpoint, self._begun_s = endpoint, begun_s
        self._said: set[str] = set()

    def note(self, error: BusError | SecretError, now_s: float) -> None:
        """Take note of why there is no bus at this moment."""
        what = "router" if isinstance(error, BusError) else "login for the router"
        if now_s - self._begun_s < TOLD_AFTER_S or what in self._said:
            return
        self._said.add(what)
        seconds = SERVICE_CONNECT_TIMEOUT_MS // 1000
        log.warning("waiting up to %d s for the %s at %s: %s", seconds, what, self._endpoint, error)


def service_bus(endpoint: str, stop: threading.Event, role: Role, access: Path | None) -> Bus:
    """Return a bus connected as `role`; leave with exit code 0 when told to stop before.

    Raises: as `connected_bus`, when no router, or no login, came within SERVICE_CONNECT_TIMEOUT_MS; at once
    for what no waiting mends: a certificate that is not there, a way that is not encrypted.
    """
    split_endpoint(endpoint)
    begun = time.monotonic()
    told, until = Told(endpoint, begun), begun + SERVICE_CONNECT_TIMEOUT_MS / 1000
    while True:
        try:
            return connected_bus(endpoint, role, access, SLICE_MS)
        except (BusError, SecretError) as error:
            if stop.is_set():
                raise typer.Exit(OK) from None
            if time.monotonic() >= until or isinstance(error, CleartextError | CertificateError):
                raise
            told.note(error, time.monotonic())
            # A router that starts side by side makes the logins; no bus has waited for it then.
            stop.wait(0.0 if isinstance(error, BusError) else SLICE_MS / 1000)


@contextmanager
def stoppable() -> Iterator[Stop]:
    """Let SIGTERM and Ctrl-C set what is yielded, which every wait of the block looks at; twice ends at once.

    What looks at it raises KeyboardInterrupt there, and nowhere else: everything drains.
    """
    stop = Stop()
    with StopSignals(stop.set):
        yield stop
