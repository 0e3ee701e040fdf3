"""Where a router is: `tcp/HOST:PORT`, or `tls/HOST:PORT` where others can read along."""

import ipaddress
from typing import Final

from services.runtime.bus import BusError

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
"""Where the router listens and everybody else connects, unless told otherwise."""
PROTOCOLS: Final = ("tcp", "tls")


def split_endpoint(endpoint: str) -> tuple[str, str, int]:
    """Return protocol, host and port of `tcp/HOST:PORT`; BusError when it is not of that form."""
    protocol, slash, address = endpoint.partition("/")
    host, colon, port = address.rpartition(":")
    if slash and colon and host and protocol in PROTOCOLS and port.isascii() and port.isdigit():
        number = int(port)
        if 0 < number < 65536:
            return protocol, host.removeprefix("[").removesuffix("]"), number
    message = f"endpoint {endpoint!r} is not of the form tcp/HOST:PORT, as in {DEFAULT_ENDPOINT}"
    raise BusError(message)


def reached_at(endpoint: str) -> str:
    """Return where programs of this machine reach a router that listens at `endpoint`."""
    protocol, host, port = split_endpoint(endpoint)
    here = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host)  # noqa: S104 - it is looked for, not bound
    return endpoint if here is None else f"{protocol}/{here}:{port}"


def is_loopback(endpoint: str) -> bool:
    """Whether only this machine can reach `endpoint`; a host name but localhost counts as reachable."""
    _, host, _ = split_endpoint(endpoint)
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
