"""Where a router is: `tcp/HOST:PORT`, or `tls/HOST:PORT` where others can read along."""

import ipaddress
import re
from typing import Final

from services.runtime.bus import BusError

DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
"""Where the router listens and everybody else connects, unless told otherwise."""
PROTOCOLS: Final = ("tcp", "tls")
NAME_CHARACTERS_MAX: Final = 253
_PORT: Final = re.compile(r"0*[1-9][0-9]{0,4}")
_NUMBERS: Final = re.compile(r"[0-9.]+")
_LABEL: Final = r"[A-Za-z0-9_]([A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?"
"""With underscores, which no host in the domain name system has, but containers do."""
_NAME: Final = re.compile(rf"{_LABEL}(\.{_LABEL})*\.?")


def split_endpoint(endpoint: str) -> tuple[str, str, int]:
    """Return protocol, host and port of `tcp/HOST:PORT`; BusError when it is not of that form."""
    protocol, slash, address = endpoint.partition("/")
    host, colon, port = address.rpartition(":")
    if slash and colon and host and protocol in PROTOCOLS and _PORT.fullmatch(port) and int(port) < 65536:
        if _is_host(host):
            return protocol, host.removeprefix("[").removesuffix("]"), int(port)
        raise BusError(
            f"endpoint {endpoint!r}: {host!r} is no host: "
            "give a name, an IPv4 address, or an IPv6 address as in [::1]"
        )
    message = f"endpoint {endpoint!r} is not of the form tcp/HOST:PORT, as in {DEFAULT_ENDPOINT}"
    raise BusError(message)


def _is_host(text: str) -> bool:
    """Whether it can be a host; numbers with dots are an address or nothing."""
    bracketed = text.startswith("[") and text.endswith("]")
    if not bracketed and not _NUMBERS.fullmatch(text):
        return len(text) <= NAME_CHARACTERS_MAX and _NAME.fullmatch(text) is not None
    try:
        address = ipaddress.ip_address(text[1:-1] if bracketed else text)
    except ValueError:
        return False
    return bracketed == (address.version == 6)


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
