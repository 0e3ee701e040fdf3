"""The name servers of a container of two networks, in the order that is harder.

An engine lists them as it likes, now one network's first and now the other's, and a resolver asks the second
only where the first is silent. So another network's than the bus comes first here, in every run.
"""

from collections.abc import Collection, Iterable
from pathlib import Path

from tests.containers.engine import Stack


def ask_the_bus_last(stack: Stack, services: Iterable[str]) -> list[str]:
    """Let containers ask the name server of another network before that of the bus; return who did not.

    It holds until a container is started again. Where the containers' files are not this machine's, nothing
    is done. Raises: EngineError.
    """
    changed = []
    for service in services:
        inspected = stack.inspect(service)
        networks = inspected["NetworkSettings"]["Networks"]
        others = {one["Gateway"] for name, one in networks.items() if name != stack.bus}
        file = Path(inspected["ResolvConfPath"])
        before = file.read_text("utf-8") if file.is_file() else ""
        if (after := with_first(before, others)) != before:
            file.write_text(after, "utf-8")
            changed.append(service)
    return changed


def with_first(text: str, addresses: Collection[str]) -> str:
    """Return a resolv.conf in which those of its name servers come before all others."""
    lines = text.splitlines(keepends=True)
    servers = [line for line in lines if line.startswith("nameserver ")]
    first = [line for line in servers if line.split()[1] in addresses]
    rest = [line for line in servers if line not in first]
    return "".join([line for line in lines if line not in servers] + first + rest)
