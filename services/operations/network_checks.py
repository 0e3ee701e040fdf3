"""What a doctor looks at on the network of this machine: ports, and the router behind its own."""

import socket
from collections.abc import Callable, Iterator

from protocol.keys import Keys
from services.operations.checks import Check, fail, ok, warn
from services.operations.status import survey
from services.runtime.bus import Bus, BusError
from services.runtime.secret import SecretError
from services.runtime.zenoh_config import is_loopback, split_endpoint

PAGES = {
    "monitor's page": 19_090,
    "picture's stream": 19_876,
    "curves' stream": 19_877,
    "teaching page": 7_480,
}
"""Ports that `sfid up` takes unless told otherwise."""


def network_checks(endpoint: str, deployment: str, connect: Callable[[], Bus]) -> Iterator[Check]:
    """Yield every check of ports and router. Args: connect: opens a bus or raises BusError, SecretError."""
    _, host, port = split_endpoint(endpoint)
    try:
        bus = connect()
    except SecretError as error:
        yield fail("router", str(error), "start the router, or name its --access directory")
        return
    except BusError as error:
        yield _without_router(host, port, endpoint, error)
        yield from _pages()
        return
    try:
        yield ok("router", f"reached at {endpoint}")
        yield from _services(bus, deployment)
    finally:
        bus.close()
    if not is_loopback(endpoint) and not endpoint.startswith("tls/"):
        yield warn("encryption", f"{endpoint} is reached in the clear", "listen at tls/HOST:PORT")


def _without_router(host: str, port: int, endpoint: str, error: BusError) -> Check:
    if is_taken(host, port):
        mend = "stop the other program, or pass another --listen and --connect"
        return fail("router", f"something else listens at {endpoint}, or lets nobody in: {error}", mend)
    return ok("router", f"none runs at {endpoint}, and its port is free")


def _pages() -> Iterator[Check]:
    taken = [f"{port} ({name})" for name, port in PAGES.items() if is_taken("127.0.0.1", port)]
    if taken:
        yield warn(
            "ports", f"taken: {', '.join(taken)}", "stop the other program, or choose ports in the TOML file"
        )
    else:
        yield ok("ports", f"{len(PAGES)} free")


def _services(bus: Bus, deployment: str) -> Iterator[Check]:
    found = survey(bus, [Keys(deployment)])
    if not found:
        yield warn(
            "services", f"none of deployment {deployment} is there", "`sfid up`, or look at --deployment"
        )
    for one in found:
        name = f"{one.role} {one.name}"
        if one.status is None or not one.ready:
            yield fail(name, one.fault, "look at its log, and start it again")
        else:
            yield ok(name, f"well, {one.status.sessions} sessions, {one.status.backlog} messages waiting")


def is_taken(host: str, port: int) -> bool:
    """Tell whether a program listens at a port of this machine."""
    with socket.socket() as probe:
        probe.settimeout(0.5)
        return probe.connect_ex((host, port)) == 0
