"""The router service: the one process that everybody else connects to, and that lets in whom it knows."""

import logging
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from services.runtime.access import Guard, certificates, make_access, note_router
from services.runtime.bus import BusError
from services.runtime.endpoint import DEFAULT_ENDPOINT, is_loopback, reached_at, split_endpoint
from services.runtime.zenoh_bus import ZenohRouter, router_config
from services.runtime.zenoh_config import LinkLimits
from services.topology import Role, access_control

log = logging.getLogger("sfid.router")


class RouterError(Exception):
    """The router cannot start; the message is one line: what is wrong, where, and the mend."""


@dataclass(frozen=True, slots=True)
class RouterConfig:
    """What the router service needs to know."""

    listen: str = DEFAULT_ENDPOINT
    """Endpoint to listen at, tcp/HOST:PORT or tls/HOST:PORT."""

    insecure_bind: bool = False
    """Listen also where other machines reach the router, although what passes is not encrypted."""

    limits: LinkLimits = field(default_factory=LinkLimits)
    """Bounds of its connections."""

    access: Path | None = None
    """Directory of logins, made where there are none; None: nobody is asked, everybody may do anything."""

    deployments: tuple[str, ...] = ("local",)
    """Those whose keys the roles may use, and with each its crowd."""


def run(config: RouterConfig, ready: Callable[[], None], stop: threading.Event) -> None:
    """Route until `stop` is set; `ready` is called once clients can connect.

    Raises RouterError when the endpoint is malformed, taken, or open to the network in clear text without
    `insecure_bind`; SecretError when logins or certificates are not to be had.
    """
    guard = _guard(config)
    refusal = (
        f"cannot listen at {config.listen}: another program has it, stop that one or pass another --listen"
    )
    try:
        router = ZenohRouter(config.listen, refusal, config.limits, guard)
    except BusError as error:
        raise RouterError(str(error)) from error
    try:
        _leave_word(config, config.access)
        ready()
        stop.wait()
    finally:
        router.close()
        _leave_word(config, None)


def written_config(config: RouterConfig) -> dict[str, Any]:
    """Return the configuration, for a router of Zenoh's own or for people to read; logins stay in their file.

    Raises: as `run`.
    """
    return router_config(config.listen, config.limits, _guard(config))


def free_endpoint() -> str:
    """Return an endpoint on this machine that nothing listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _guard(config: RouterConfig) -> Guard | None:
    tls = _protocol(config) == "tls"
    if config.access is None:
        return None
    users = make_access(config.access, [role.value for role in Role if role is not Role.ROUTER])
    rules = access_control(config.deployments, tls=tls)
    return Guard(users.resolve(), rules, certificates(config.access, "router") if tls else None)


def _protocol(config: RouterConfig) -> str:
    """Return tcp or tls, unless others could read along, or be let in without a login."""
    try:
        protocol, _, _ = split_endpoint(config.listen)
        loopback = is_loopback(config.listen)
    except BusError as error:
        raise RouterError(str(error)) from error
    if protocol == "tls" and config.access is None:
        message = f"{config.listen}: TLS takes certificates: name their directory with --access"
        raise RouterError(message)
    if protocol == "tcp" and not loopback and not config.insecure_bind:
        message = (
            f"{config.listen} can be reached from other machines and nothing there is encrypted: listen at "
            f"{DEFAULT_ENDPOINT} or at tls/HOST:PORT (SECURITY.md), or, trusting everybody there, run "
            "`sfid router --insecure-bind`"
        )
        raise RouterError(message)
    return protocol


def _leave_word(config: RouterConfig, folder: Path | None) -> None:
    """Tell this person's programs on this machine where the logins are, so that no step is needed of them."""
    try:
        note_router(reached_at(config.listen), folder)
    except OSError as error:
        log.warning("programs here are to be given --access: %s", error.strerror or error)
