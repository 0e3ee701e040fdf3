"""How the services of a deployment do: who is there by their tokens, and what each says when it is asked."""

import queue
import time
from collections.abc import Iterable
from dataclasses import dataclass

from protocol.codec import DecodeError, decode
from protocol.keys import KeyNameError, Keys
from protocol.messages import Refusal
from protocol.status_message import ServiceStatus
from services.runtime.bus import Bus, Presence, Reply

QUIET_S = 0.25
"""No further token for so long: these are all. Tokens that stand come within a few ms."""
ASK_TIMEOUT_MS = 2_000
"""A loop that does not answer within this hangs, or has more to do than it can."""

USUAL_NAMES = {
    "environment": "environment",
    "learner": "shard-0",
    "aggregator": "crowd",
    "gateway": "0",
    "monitor": "0",
}
"""Name of a role's first service: whom a health check asks unless told otherwise."""


@dataclass(frozen=True, slots=True)
class Found:
    """A service that is there, or should be."""

    deployment: str
    role: str
    name: str
    status: ServiceStatus | None
    """What it said; None when it said nothing."""
    fault: str = ""
    """Why not; empty when it did."""

    @property
    def ready(self) -> bool:
        """Whether it can be used."""
        return self.status is not None and self.status.ready


def survey(bus: Bus, deployments: Iterable[Keys], expected: Iterable[str] = ()) -> list[Found]:
    """Return every service of the deployments, by role and name, and the expected roles that are missing."""
    found: list[Found] = []
    for keys in deployments:
        names = sorted(present(bus, keys))
        found += [ask(bus, keys, role, name) for role, name in names]
    there = {one.role for one in found}
    first = next(iter(deployments), Keys())
    return found + [
        Found(first.deployment, role, USUAL_NAMES.get(role, "0"), None, "it is not there")
        for role in expected
        if role not in there
    ]


def present(bus: Bus, keys: Keys) -> set[tuple[str, str]]:
    """Return (role, name) of the services whose tokens stand."""
    seen: queue.SimpleQueue[Presence] = queue.SimpleQueue()
    bus.watch(keys.service(), seen.put)
    there: set[str] = set()
    until = time.monotonic() + QUIET_S
    while (left_s := until - time.monotonic()) > 0:
        try:
            presence = seen.get(timeout=left_s)
        except queue.Empty:
            break
        (there.add if presence.present else there.discard)(presence.key)
        until = time.monotonic() + QUIET_S
    named: set[tuple[str, str]] = set()
    for key in there:
        try:
            named.add(keys.role_and_name(key))
        except KeyNameError:  # anybody may announce anything
            continue
    return named


def ask(bus: Bus, keys: Keys, role: str, name: str, timeout_ms: int = ASK_TIMEOUT_MS) -> Found:
    """Ask one service how it does; nothing and an error both mean: not ready."""
    replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    bus.ask(keys.status(role, name), b"", replies.put, timeout_ms)
    reply = replies.get()
    if reply is None:
        fault = f"no answer within {timeout_ms / 1000:g} s: it is not there, or its loop hangs"
        return Found(keys.deployment, role, name, None, fault)
    try:
        if not reply.ok:
            return Found(keys.deployment, role, name, None, decode(reply.payload, Refusal).reason)
        status = decode(reply.payload, ServiceStatus)
    except DecodeError as error:
        return Found(keys.deployment, role, name, None, f"its answer cannot be read ({error})")
    return Found(keys.deployment, role, name, status, status.reason)
