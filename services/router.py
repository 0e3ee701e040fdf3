"""The router service: the one process that everybody else connects to, and that lets in whom it knows."""

import json
import logging
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from services.router_links import ANSWER_MS, CHECK_S, Link, LinkLog, LinkWatch, allow_links
from services.runtime.access import Guard, certificates, make_access, note_router, read_access
from services.runtime.bus import BusError
from services.runtime.endpoint import DEFAULT_ENDPOINT, is_loopback, reached_at, split_endpoint
from services.runtime.handed_logins import hand_out
from services.runtime.secret import written_anew
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

    connect: tuple[str, ...] = ()
    """Endpoints of other routers to link with, now or when they come."""

    link: Link = Link.ROUTER
    """As what it is linked to them."""

    insecure_bind: bool = False
    """Listen and link also where other machines are, although what passes is not encrypted."""

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
    router = _opened(config, guard)
    try:
        _leave_word(config, config.access)
        ready()
        watch, links = LinkWatch(), LinkLog(config.connect)
        while not stop.wait(CHECK_S if config.connect else None):
            neighbours = router.neighbours(ANSWER_MS)
            if line := links.line(neighbours):
                log.log(logging.INFO if neighbours else logging.WARNING, line)
            if watch.wants_anew(neighbours):
                log.warning("a link carries nothing: this router starts anew, its clients come back")
                router.close()
                router = _opened(config, guard)
    finally:
        router.close()
        _leave_word(config, None)


def _opened(config: RouterConfig, guard: Guard | None) -> ZenohRouter:
    refusal = (
        f"cannot listen at {config.listen}: another program has it, stop that one or pass another --listen"
    )
    try:
        return ZenohRouter(config.listen, refusal, config.limits, guard, config.connect)
    except BusError as error:
        raise RouterError(str(error)) from error


def written_config(config: RouterConfig) -> dict[str, Any]:
    """Return the configuration, for a router of Zenoh's own or for people to read; logins stay in their file.

    Of a router that connects to others, theirs asks for one: `zenohd_file` has it.  Raises: as `run`.
    """
    guard = _guard(config)
    return router_config(config.listen, config.limits, guard and replace(guard, login=None), config.connect)


def zenohd_file(config: RouterConfig, path: Path) -> None:
    """Write the whole configuration for a router of Zenoh's own, with its login, for its owner alone to read.

    Raises: as `run`; RouterError when the file cannot be written.
    """
    text = json.dumps(router_config(config.listen, config.limits, _guard(config), config.connect), indent=2)
    try:
        written_anew(path, f"{text}\n".encode())
    except OSError as error:
        message = f"{path}: {error.strerror or error}: name a file in a directory that can be written"
        raise RouterError(message) from None


def free_endpoint() -> str:
    """Return an endpoint on this machine that nothing listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _guard(config: RouterConfig) -> Guard | None:
    protocols = [
        _protocol(config, config.listen, linked=False),
        *(_protocol(config, endpoint, linked=True) for endpoint in config.connect),
    ]
    if config.access is None:
        return None
    folder = config.access.resolve()
    roles = [role.value for role in Role if role is not Role.ROUTER]
    if "tls" in protocols:
        roles += [link.value for link in Link]
    users = make_access(folder, roles)
    hand_out(folder, roles)
    rules = access_control(config.deployments, tls=protocols[0] == "tls")
    if "tls" not in protocols:
        return Guard(users, rules)
    return Guard(
        users,
        allow_links(rules, config.deployments),
        certificates(folder, config.link.value),
        read_access(folder, config.link.value) if config.connect else None,
    )


def _protocol(config: RouterConfig, endpoint: str, *, linked: bool) -> str:
    """Return tcp or tls, unless others could read along, or be let in without a login."""
    try:
        protocol, _, _ = split_endpoint(endpoint)
        loopback = is_loopback(endpoint)
    except BusError as error:
        raise RouterError(str(error)) from error
    if protocol == "tls" and config.access is None:
        message = f"{endpoint}: TLS takes certificates: name their directory with --access"
    elif protocol == "tcp" and linked and config.access is not None:
        message = (
            f"{endpoint}: a router that asks for logins knows another by its certificate: connect to "
            "tls/HOST:PORT (MACHINES.md), or let both ask nobody, with `sfid router --open-to-all`"
        )
    elif protocol == "tcp" and not loopback and not config.insecure_bind:
        message = f"{_exposed(endpoint, linked=linked)}, or, trusting everybody there, run {_INSECURE}"
    elif linked and endpoint == config.listen:
        message = f"{endpoint}: a router cannot be linked with itself: name another one with --connect"
    else:
        return protocol
    raise RouterError(message)


_INSECURE: Final = "`sfid router --insecure-bind`"


def _exposed(endpoint: str, *, linked: bool) -> str:
    if linked:
        return (
            f"{endpoint} is on another machine and nothing on the way is encrypted: connect to tls/HOST:PORT "
            "(MACHINES.md)"
        )
    return (
        f"{endpoint} can be reached from other machines and nothing there is encrypted: listen at "
        f"{DEFAULT_ENDPOINT} or at tls/HOST:PORT (SECURITY.md)"
    )


def _leave_word(config: RouterConfig, folder: Path | None) -> None:
    """Tell this person's programs on this machine where the logins are, so that no step is needed of them."""
    try:
        note_router(reached_at(config.listen), folder)
    except OSError as error:
        log.warning("programs here are to be given --access: %s", error.strerror or error)
