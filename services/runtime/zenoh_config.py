"""Zenoh configurations as plain data: one for a client, one for the router, and the limits of both."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from services.runtime.access import Access, Certificates, Guard
from services.runtime.endpoint import DEFAULT_ENDPOINT, PROTOCOLS, is_loopback, split_endpoint

__all__ = [
    "DEFAULT_ENDPOINT",
    "THREADS_VARIABLE",
    "LinkLimits",
    "client_config",
    "is_loopback",
    "router_config",
    "share_threads",
    "split_endpoint",
]

THREADS_VARIABLE: Final = "ZENOH_RUNTIME"
"""The environment variable in which Zenoh looks for its threads, once a process, at the first session."""
THREADS: Final = "(net: (handover: tx), acc: (handover: tx), app: (handover: tx), tx: (worker_threads: 4))"
"""Four threads for all but receiving, as many as Zenoh starts for the four by themselves.

A message then wakes fewer of them on its way: measured, a quarter to a third less processor time for each
acknowledged answer, in router, learner and teachers alike (`tests/benchmarks/label_latency.py`).
"""


def share_threads() -> None:
    """Have Zenoh start THREADS in this process, unless its variable says otherwise: before any session."""
    os.environ.setdefault(THREADS_VARIABLE, THREADS)


@dataclass(frozen=True, slots=True)
class LinkLimits:
    """The numbers that bound a connection; router and clients of one deployment share them."""

    lease_ms: int = 2500
    """A process that has been silent for so long counts as gone (a killed one is noticed at once, by its
    socket). Measured: the break comes at 0.84-0.96 of it."""

    retry_ms_min: int = 100
    """First wait before connecting again; it doubles up to `retry_ms_max`."""

    retry_ms_max: int = 500
    """Longest wait before connecting again: a restarted router has its clients back in about 0.6 s."""

    open_timeout_ms: int = 1000
    """Most time for the handshake with a router that accepts but does not speak (one that is stopped).
    Opening, and closing while reconnecting, can take so long; it is 2 ms with a router that is well."""

    message_bytes_max: int = 65536
    """Largest payload. The router drops larger ones in silence, whoever sends them: Zenoh's own
    max_message_size bounds only the messages that do not fit one 64 KiB batch."""

    sessions_max: int = 5000
    """Most clients of one router; 2000 have been measured at 65-100 kB of memory each."""


def client_config(
    endpoint: str, limits: LinkLimits | None = None, access: Access | None = None
) -> dict[str, Any]:
    """Return the configuration of a client of the router at `endpoint`.

    A client opens no listening socket, finds nobody by multicast or gossip, and shares no memory: what passes
    between two processes passes the router, and so its access control.

    Args: access: who this client is; None for a router that asks nobody.
    """
    limits = limits or LinkLimits()
    split_endpoint(endpoint)
    transport = _transport(limits)
    if access is not None:
        transport["auth"] = {"usrpwd": {"user": access.user, "password": access.password}}
        if access.certificates is not None:
            transport["link"]["tls"] = _tls(access.certificates, "connect")
    return {
        "mode": "client",
        # One attempt: the caller waits, because Ctrl-C does not interrupt Zenoh's own waiting.
        "connect": {"endpoints": [endpoint], "timeout_ms": 0, "retry": _retry(limits)},
        "scouting": _NO_SCOUTING,
        "transport": transport,
    }


def router_config(
    listen: str, limits: LinkLimits | None = None, guard: Guard | None = None, connect: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the configuration of a router that listens at `listen` only.

    Args: guard: whom it lets in, to do what; None: everybody, everything.  connect: other routers to link
    with; it starts without those that are not there, and goes on trying.
    """
    limits = limits or LinkLimits()
    for endpoint in (listen, *connect):
        split_endpoint(endpoint)
    transport = _transport(limits)
    guarded: dict[str, Any] = {}
    if guard is not None:
        _admit(transport, guard)
        guarded = {"access_control": guard.rules}
    return {
        "mode": "router",
        "listen": {"endpoints": [listen], "timeout_ms": 0, "exit_on_failure": True},
        "connect": {
            "endpoints": list(connect),
            "timeout_ms": -1,
            "exit_on_failure": False,
            "retry": _retry(limits),
        },
        "scouting": _NO_SCOUTING,
        "adminspace": {"enabled": False},
        "transport": transport,
        **guarded,
        "low_pass_filter": [
            {
                "id": "message_bytes_max",
                "messages": ["put", "delete", "query", "reply"],
                "flows": ["ingress"],
                "key_exprs": ["**"],
                "size_limit": limits.message_bytes_max,
            }
        ],
    }


# delay: a router waits 500 ms for scouting answers at its start, which never come when nobody is asked.
_NO_SCOUTING: Final = {"multicast": {"enabled": False}, "gossip": {"enabled": False}, "delay": 0}


def _retry(limits: LinkLimits) -> dict[str, Any]:
    return {
        "period_init_ms": limits.retry_ms_min,
        "period_max_ms": limits.retry_ms_max,
        "period_increase_factor": 2,
    }


def _admit(transport: dict[str, Any], guard: Guard) -> None:
    """Say whom a router lets in, and as whom it goes to other routers."""
    login: dict[str, str] = {}
    if guard.login is not None:
        login = {"user": guard.login.user, "password": guard.login.password}
    transport["auth"] = {"usrpwd": {"dictionary_file": str(guard.users), **login}}
    if guard.certificates is not None:
        both = _tls(guard.certificates, "listen") | _tls(guard.certificates, "connect")
        transport["link"]["tls"] = both


def _tls(files: Certificates, side: str) -> dict[str, Any]:
    """Return the part for TLS in which both ends show a certificate of the same authority."""
    return {
        "root_ca_certificate": str(files.authority),
        f"{side}_certificate": str(files.certificate),
        f"{side}_private_key": str(files.key),
        "enable_mtls": True,
        "verify_name_on_connect": True,
    }


def _transport(limits: LinkLimits) -> dict[str, Any]:
    return {
        # Shared memory would cap a router at 351 local clients and is outside its message limit.
        "shared_memory": {"enabled": False},
        "unicast": {
            "max_sessions": limits.sessions_max,
            "open_timeout": limits.open_timeout_ms,
            "accept_timeout": limits.open_timeout_ms,
        },
        "link": {
            "protocols": list(PROTOCOLS),
            "tx": {"lease": limits.lease_ms},
            # Room for the key and the headers around the largest payload, so that the payload limit is exact.
            "rx": {"max_message_size": limits.message_bytes_max + 4096},
        },
    }
