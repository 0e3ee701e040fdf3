"""Bridges that keep their hardware address: without, containers of an older Podman find no names for a while.

A Linux bridge whose address nobody has set takes the lowest of its ports'. So it may change whenever a
container joins or leaves, and the others go on asking the name server, which is at the bridge, at the old
address: until their kernels doubt it, which takes up to 100 s, no name is found
(https://github.com/containers/netavark/pull/833). Docker sets the address, and so does netavark since
that change; Podman 4.3 of Debian 12, with netavark 1.4, does not.
"""

from pathlib import Path

from tests.containers.engine import EngineError, Stack, succeeds

INTERFACES = Path("/sys/class/net")


def keep_bridge_addresses(stack: Stack) -> list[str]:
    """Set the address of each bridge of the stack to the one it has; return those where it could be done.

    It takes the rights to do so, and an engine whose bridges are this machine's: elsewhere nothing is done.
    """
    commands = pinning(stack)
    return [command[4] for command in commands if succeeds(*command)]


def pinning(stack: Stack, interfaces: Path = INTERFACES) -> list[tuple[str, ...]]:
    """Return the commands that do it. Raises: EngineError when the engine does not list its networks."""
    if stack.engine.tool.endswith("docker"):
        return []
    named = ("--filter", f"name={stack.project}_", "--format", "{{.Name}}")
    bridges = (_bridge(stack, network) for network in stack.tool("network", "ls", *named).split())
    files = {bridge: interfaces / bridge / "address" for bridge in bridges if bridge}
    return [
        ("ip", "link", "set", "dev", bridge, "address", file.read_text("ascii").strip())
        for bridge, file in files.items()
        if file.is_file()
    ]


def _bridge(stack: Stack, network: str) -> str:
    try:
        return stack.tool("network", "inspect", network, "--format", "{{.NetworkInterface}}").strip()
    except EngineError:  # an engine that names it otherwise
        return ""
