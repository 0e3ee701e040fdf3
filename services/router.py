"""The router service: the one process that everybody else connects to."""

import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from services.runtime.bus import BusError
from services.runtime.zenoh_bus import ZenohRouter
from services.runtime.zenoh_config import DEFAULT_ENDPOINT, LinkLimits, is_loopback


class RouterError(Exception):
    """The router cannot start; the message is one line: what is wrong, where, and the mend."""


@dataclass(frozen=True, slots=True)
class RouterConfig:
    """What the router service needs to know."""

    listen: str = DEFAULT_ENDPOINT
    """Endpoint to listen at, tcp/HOST:PORT."""

    insecure_bind: bool = False
    """Listen also where other machines reach the router, although it asks nobody for a password."""

    limits: LinkLimits = field(default_factory=LinkLimits)
    """Bounds of its connections."""


def run(config: RouterConfig, ready: Callable[[], None], stop: threading.Event) -> None:
    """Route until `stop` is set; `ready` is called once clients can connect.

    Raises RouterError when the endpoint is malformed, taken, or open to the network without `insecure_bind`.
    """
    _refuse_open_endpoint(config)
    refusal = (
        f"cannot listen at {config.listen}: another program has it, stop that one or pass another --listen"
    )
    try:
        router = ZenohRouter(config.listen, refusal, config.limits)
    except BusError as error:
        raise RouterError(str(error)) from error
    try:
        ready()
        stop.wait()
    finally:
        router.close()


def free_endpoint() -> str:
    """Return an endpoint on this machine that nothing listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _refuse_open_endpoint(config: RouterConfig) -> None:
    try:
        loopback = is_loopback(config.listen)
    except BusError as error:
        raise RouterError(str(error)) from error
    if not loopback and not config.insecure_bind:
        message = (
            f"{config.listen} can be reached from other machines and asks nobody for a password: "
            f"listen at {DEFAULT_ENDPOINT}, or, trusting everybody there, run `sfid router --insecure-bind`"
        )
        raise RouterError(message)
