"""How the services of a deployment do: who is there by their tokens, and what each says when it is asked."""

import queue
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

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


class Board:
    """Who is there in some deployments: watches their tokens from now on."""

    def __init__(self, bus: Bus, deployments: Iterable[Keys]) -> None:
        self.deployments = tuple(deployments)
        self._bus = bus
        self._seen: queue.SimpleQueue[tuple[Keys, Presence]] = queue.SimpleQueue()
        self._present: set[tuple[Keys, str, str]] = set()
        for keys in self.deployments:
            bus.watch(keys.service(), partial(self._note, keys))

    def _note(self, keys: Keys, presence: Presence) -> None:
        self._seen.put((keys, presence))

    def names(self, quiet_s: float = 0.0) -> list[tuple[Keys, str, str]]:
        """Return (deployment, role, name) of all who are there, once nothing has changed for `quiet_s`."""
        while True:
            try:
                keys, presence = self._seen.get(timeout=quiet_s) if quiet_s else self._seen.get_nowait()
            except queue.Empty:
                return sorted(self._present, key=lambda one: (one[0].deployment, *one[1:]))
            try:
                one = (keys, *keys.role_and_name(presence.key))
            except KeyNameError:  # anybody may announce anything
                continue
            (self._present.add if presence.present else self._present.discard)(one)

    def survey(self, expected: Iterable[str] = (), quiet_s: float = 0.0) -> list[Found]:
        """Return every service that is there, asked how it does, and the expected roles that are missing."""
        found = [ask(self._bus, *one) for one in self.names(quiet_s)]
        there = {one.role for one in found}
        return [*found, *shards_without_learner(found)] + [
            Found(self.deployments[0].deployment, role, USUAL_NAMES.get(role, "0"), None, "it is not there")
            for role in expected
            if role not in there
        ]


def shards_without_learner(found: list[Found]) -> Iterable[Found]:
    """Yield the shards whose sessions nobody has, as far as the learners that are there know of shards."""
    learners = [one for one in found if one.role == "learner"]
    there = {(one.deployment, one.name) for one in learners}
    known = {one.deployment: one.status.shards for one in learners if one.status is not None}
    for deployment, shards in known.items():
        for name in (f"shard-{number}" for number in range(shards)):
            if (deployment, name) not in there:
                yield Found(deployment, "learner", name, None, "no learner has it: its sessions wait")


def survey(bus: Bus, deployments: Iterable[Keys], expected: Iterable[str] = ()) -> list[Found]:
    """Return every service of the deployments, by role and name, and the expected roles that are missing."""
    return Board(bus, deployments).survey(expected, QUIET_S)


def ask(bus: Bus, keys: Keys, role: str, name: str, timeout_ms: int = ASK_TIMEOUT_MS) -> Found:
    """Ask one service how it does; nothing and an error both mean: not ready."""
    replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    bus.ask(keys.status(role, name), b"", replies.put, timeout_ms)
    return understood(keys, role, name, replies.get(), timeout_ms)


def understood(
    keys: Keys, role: str, name: str, reply: Reply | None, timeout_ms: int = ASK_TIMEOUT_MS
) -> Found:
    """Return what a reply to the question of how a service does says about it."""
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
