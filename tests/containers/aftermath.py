"""What is to be known of every container when a phase of the test fails: they are gone afterwards."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.containers.engine import EngineError, Stack

LINES = "40"
"""Last lines of each container's log."""
LOOK_UP = """import socket
print(*open('/etc/resolv.conf').read().split())
print(*sorted({each[4][0] for each in socket.getaddrinfo('router', 7447)}))"""


@contextmanager
def told_when_failing(stack: Stack) -> Iterator[None]:
    """Print how the containers stand when something fails within."""
    try:
        yield
    except BaseException:
        sys.stdout.write(aftermath(stack))
        raise


def aftermath(stack: Stack) -> str:
    """Return state, addresses, name lookups and the log's end of every container of the stack.

    It never raises: what cannot be found out is said in its place.
    """
    try:
        listed = stack.tool("ps", "--all", "--filter", f"name={stack.project}", "--format", "{{.Names}}")
    except EngineError as error:
        return f"\nno container of {stack.project} is known: {error}\n"
    known = {name: _inspected(stack, name) for name in listed.split()}
    routers = [name for name in known if name.rstrip("-_0123456789").endswith("router")]
    wanted = " ".join(_addresses(known[routers[0]]).values()) if routers else ""
    parts = [f"containers of {stack.project}; the router is at {wanted or 'no address'}"]
    parts += [_told(stack, name, inspected, wanted) for name, inspected in known.items()]
    return "\n".join(["", *parts, ""])


def _told(stack: Stack, name: str, inspected: dict[str, Any], router: str) -> str:
    state = inspected.get("State", {})
    addresses = ", ".join(f"{network} {address}" for network, address in _addresses(inspected).items())
    lines = [f"addresses {addresses or 'none'}", f"state {json.dumps(state)}"]
    if state.get("Running"):
        *asked, found = _tried(stack, "exec", name, "python", "-c", LOOK_UP).splitlines() or ["no answer"]
        lines = [f"---- {name}: {verdict(found, router)}", *asked, *lines]
    else:
        lines = [f"---- {name}: does not run", *lines]
    return "\n".join([*lines, _tried(stack, "logs", "--tail", LINES, name)])


def verdict(found: str, router: str) -> str:
    """Return whose fault it would be that a container does not reach the router.

    Args: found: the last that looking its name up printed; router: its addresses, as the engine has them.
    """
    addresses = found.split()
    if not addresses or not all(address[0].isdigit() for address in addresses):
        return f"the engine's names fail here: {found or 'no answer'}"
    if not set(addresses) & set(router.split()):
        return f"the engine's names are stale here: the router is not at {found}"
    return f"finds the router at {found}: a link that is missing now is not the engine's fault"


def _inspected(stack: Stack, name: str) -> dict[str, Any]:
    try:
        found: list[dict[str, Any]] = json.loads(stack.tool("inspect", name))
    except (EngineError, ValueError):
        return {}
    return found[0]


def _addresses(inspected: dict[str, Any]) -> dict[str, str]:
    networks = inspected.get("NetworkSettings", {}).get("Networks") or {}
    return {network: one["IPAddress"] for network, one in sorted(networks.items()) if one["IPAddress"]}


def _tried(stack: Stack, *words: str) -> str:
    try:
        return stack.tool(*words, both=True).strip()
    except EngineError as error:
        return str(error).strip()
