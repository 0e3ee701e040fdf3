"""Configuration of a gateway, and its limits."""

import ssl
from dataclasses import dataclass, field
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import urlsplit

from services.runtime.secret import FOLDER

DEFAULT_LISTEN = "127.0.0.1:7480"
_WILDCARDS = frozenset({"0.0.0.0", "::"})  # noqa: S104 - named to be refused


class GatewayError(Exception):
    """The gateway cannot start; the message is one line: what is wrong, where, and the mend."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of everything that comes from a browser."""

    frame_bytes_max: int = 4096
    frames_queued_max: int = 8
    """Frames of one connection that wait to be read; then its TCP window closes."""
    connections_max: int = 600
    """Open connections in all, those included that only fetch the page."""
    connections_per_address_max: int = 400
    """A class behind one router shares an address; a person has one connection, and fetches a few files."""
    frames_per_s: float = 20.0
    """What a person may send, averaged: answers come at most at a few a second."""
    frames_burst: int = 40
    refused_max: int = 100
    """Frames over the rate, after which the connection is closed; one is forgiven with each honest frame."""
    hellos_per_minute: float = 30.0
    """Connections a person may open: reloads and lost networks need a few."""
    hello_timeout_s: float = 5.0
    open_timeout_s: float = 5.0
    """How long a connection may take to make its request."""
    ping_s: float = 15.0
    """A browser that answers no ping for so long is gone."""
    idle_timeout_s: float = 4 * 3600.0
    """Without any answer or wish for so long, a page that was left open is let go."""
    buffered_bytes_max: int = 262_144
    """What may wait to be sent to a browser that does not read; beyond it the connection is ended."""
    answers_open_max: int = 64
    """Answers of one person without an acknowledgement."""
    leave_ms: int = 3000
    """How long a person stays present in the session after the connection went: a reload takes one second."""
    rooms_max: int = 1000
    people_max: int = 2000


@dataclass(frozen=True, slots=True)
class GatewayConfig:
    """One gateway process."""

    data_dir: Path
    """The deployment's data directory; the gateway's files are below `gateway/` in it."""
    deployment: str = "local"
    listen: str = DEFAULT_LISTEN
    url: str | None = None
    """The address that browsers use, where it is not the one listened at (behind a proxy, on a wildcard)."""
    tls_cert: Path | None = None
    tls_key: Path | None = None
    insecure_bind: bool = False
    """Listen where other machines reach it, without TLS."""
    limits: Limits = field(default_factory=Limits)

    @property
    def folder(self) -> Path:
        """Where the gateway keeps its secret, its register and its status."""
        return self.data_dir / FOLDER


@dataclass(frozen=True, slots=True)
class Place:
    """Where a gateway listens, and the address that people are given."""

    host: str
    port: int
    scheme: str
    url: str | None
    """Fixed by the configuration; None: made from host and port once the port is known."""
    tls: ssl.SSLContext | None

    def address(self, port: int) -> str:
        """Return the page's address without a slash at its end."""
        if self.url is not None:
            return self.url
        host = f"[{self.host}]" if ":" in self.host else self.host
        usual = {"http": 80, "https": 443}[self.scheme] == port
        return f"{self.scheme}://{host}" + ("" if usual else f":{port}")


def place_of(config: GatewayConfig) -> Place:
    """Return where to listen. Raises GatewayError for what cannot be read or would be open to a network."""
    host, port = _split(config.listen)
    tls = _tls(config)
    loopback = _is_loopback(host)
    if not loopback and tls is None and not config.insecure_bind:
        message = (
            f"{config.listen} can be reached from other machines and nothing would be encrypted: give "
            f"--tls-cert and --tls-key, listen at {DEFAULT_LISTEN}, or, trusting everybody there, "
            "say --insecure-bind"
        )
        raise GatewayError(message)
    if host in _WILDCARDS and config.url is None:
        raise GatewayError(f"{config.listen} has no address to invite people to: give it as --url")
    url = None if config.url is None else _checked_url(config.url)
    return Place(host, port, "http" if tls is None else "https", url, tls)


def _split(listen: str) -> tuple[str, int]:
    host, _, port = listen.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or int(port) > 65_535:
        raise GatewayError(f"--listen {listen!r} is no address: write HOST:PORT, as in {DEFAULT_LISTEN}")
    return host, int(port)


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _checked_url(url: str) -> str:
    parts = urlsplit(url)
    plain = not (parts.path.strip("/") or parts.query or parts.fragment or parts.username)
    if parts.scheme not in {"http", "https"} or not parts.hostname or not plain:
        raise GatewayError(f"--url {url!r} is no page address: write https://HOST or https://HOST:PORT")
    return f"{parts.scheme}://{parts.netloc.lower()}"


def _tls(config: GatewayConfig) -> ssl.SSLContext | None:
    if config.tls_cert is None and config.tls_key is None:
        return None
    if config.tls_cert is None or config.tls_key is None:
        raise GatewayError("TLS needs both --tls-cert and --tls-key: give the one that is missing")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(config.tls_cert, config.tls_key)
    except OSError as error:  # ssl.SSLError is one
        message = f"{config.tls_cert}, {config.tls_key}: {error.strerror or error}: give a PEM pair"
        raise GatewayError(message) from None
    return context
