"""Routers of a test, linked to one another, and what passes from one to the other."""

import queue
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from services.router import RouterConfig, free_endpoint, run
from services.runtime.access import access_for
from services.runtime.bus import Reply
from services.runtime.zenoh_bus import ZenohBus, open_bus
from services.topology import Role
from tests.services.security.certificates import Authority

DEADLINE_S = 10.0
_PAUSE_S = 0.01


@contextmanager
def routing(config: RouterConfig) -> Iterator[None]:
    """Run a router for the time of the block."""
    ready, stop = threading.Event(), threading.Event()
    thread = threading.Thread(target=run, args=(config, ready.set, stop))
    thread.start()
    try:
        assert ready.wait(DEADLINE_S)
        yield
    finally:
        stop.set()
        thread.join(DEADLINE_S)


def tls_endpoint() -> str:
    """Return a free endpoint of this machine at which TLS is spoken."""
    return free_endpoint().replace("tcp/", "tls/")


def ask(bus: ZenohBus, key: str) -> Reply | None:
    """Ask once."""
    replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    bus.ask(key, b"", replies.put, 2_000)
    return replies.get(timeout=DEADLINE_S)


def ask_until_served(bus: ZenohBus, key: str) -> Reply:
    """Ask until there is an answer: a link, or what is declared over it, may still be on its way."""
    pause = threading.Event()
    for _ in range(int(DEADLINE_S / _PAUSE_S)):
        if (reply := ask(bus, key)) is not None:
            return reply
        pause.wait(_PAUSE_S)
    raise AssertionError(f"nobody answers {key}")


def certified(folder: Path, *roles: str) -> Path:
    """Return the folder with certificates of an authority of its own for these roles."""
    folder.mkdir()
    authority = Authority(folder)
    for role in roles:
        authority.sign(folder, role)
    return folder


def carried(folder: Path, to: Path, *roles: str) -> Path:
    """Return a new folder with the authority's certificate and what these roles have in `folder`."""
    to.mkdir()
    for path in folder.iterdir():
        if path.name == "ca.pem" or path.stem in roles:
            shutil.copy(path, to)
    return to


def bus_of(role: Role, endpoint: str, folder: Path | None) -> ZenohBus:
    """Return a bus of that role at one of the routers."""
    access = None if folder is None else access_for(endpoint, role.value, folder)
    return open_bus(endpoint, 5_000, access=access)
