"""What passes between routers: who another router is, and which messages its link may carry."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum
from typing import Any

from protocol.keys import Keys, router_key
from services.topology import Node, Role, rules_of, topology


class Link(Enum):
    """As what a router is linked to others: the common name of its certificate, and its login."""

    ROUTER = "router"
    """Carries everything: it is trusted to let in each role to do what is that role's, as this one is."""
    EDGE = "edge"
    """Stands where only people are: whatever it lets in there, here it may do what they and their gateways
    may."""


CHECK_S = 1.0
"""Pause between two looks at the links."""
ANSWER_MS = 1_000
"""So long is waited for another router to answer."""
LOOKS = 3
"""So many in a row must find a link carrying nothing: routes are computed 0.1 s after it came, and the other
may be busy."""


class LinkWatch:
    """Whether a router should start anew, because a linked one is not found (`ZenohRouter.neighbours`).

    One of Zenoh's own is never found, and starting anew does not change that: it is tried again ever later,
    after 3, 12, 48, ... looks.
    """

    def __init__(self) -> None:
        self._missed: Counter[str] = Counter()
        self._tries: Counter[str] = Counter()

    def wants_anew(self, neighbours: Mapping[str, bool]) -> bool:
        """Take one look at the links, and say whether it is time."""
        missing = {zid for zid, found in neighbours.items() if not found}
        for zid in neighbours.keys() - missing:
            del self._tries[zid]
        self._missed = Counter({zid: self._missed[zid] + 1 for zid in missing})
        overdue = {zid for zid in missing if self._missed[zid] >= LOOKS * 4 ** self._tries[zid]}
        self._tries.update(overdue)
        return bool(overdue)


class LinkLog:
    """What is said of the links of a router that connects to others: each change once.

    Args: endpoints: those that it connects to.
    """

    def __init__(self, endpoints: Sequence[str]) -> None:
        self._names, self._wanted = ", ".join(endpoints), len(endpoints)
        self._said: str | None = None
        self._ever = False
        self._silent = 0

    def line(self, neighbours: Mapping[str, bool]) -> str | None:
        """Take one look at the links, and return what is to be said now; None: nothing new."""
        standing = len(neighbours)
        self._silent = self._silent + 1 if standing and not all(neighbours.values()) else 0
        if 0 < self._silent < LOOKS:
            return None  # too early to say: routes are computed only after a link came
        said = self._text(standing)
        self._ever = self._ever or bool(standing)
        if said == self._said:
            return None
        self._said = said
        return said

    def _text(self, standing: int) -> str:
        if not standing:
            lost = f"link to {self._names} lost, trying to reach it again"
            hint = "is its router up, and does it know this login and certificate (MACHINES.md)?"
            return lost if self._ever else f"no link to {self._names} yet, trying: {hint}"
        some = "" if standing >= self._wanted else f"{standing} of "
        silent = ", but not every one there answers: zenohd never does" if self._silent else ""
        return f"linked with {some}{self._names}{silent}"


EDGE_ROLES = (Role.TEACHER, Role.WORKER, Role.GATEWAY)
"""Who may stand behind an edge."""
_BOTH = ("ingress", "egress")
_ASKING = ("query", "reply", "declare_queryable")
_PASSING = (
    # what roles do, which messages that makes between two routers, of which either may have either side
    (("publishes", "subscribes"), ("put", "declare_subscriber")),
    (("serves", "asks"), _ASKING),
    (
        ("announces", "watches"),
        ("liveliness_token", "declare_liveliness_subscriber", "liveliness_query"),
    ),
)


def allow_links(control: dict[str, Any], deployments: Iterable[str]) -> dict[str, Any]:
    """Return an access control with which other routers may also be linked, each as what it is.

    A router is known by its certificate alone: of a login only the accepting side of a link knows.
    """
    nodes = [node for deployment in deployments for node in topology(Keys(deployment))]
    rules = {
        Link.ROUTER: list(_router_rules(nodes)),
        Link.EDGE: list(_edge_rules([node for node in nodes if node.role in EDGE_ROLES])),
    }
    return control | {
        "rules": [*control["rules"], *rules[Link.ROUTER], *rules[Link.EDGE]],
        "subjects": [
            *control["subjects"],
            *({"id": link.value, "cert_common_names": [link.value]} for link in Link),
        ],
        "policies": [
            *control["policies"],
            *({"rules": [rule["id"] for rule in rules[link]], "subjects": [link.value]} for link in Link),
        ],
    }


def _router_rules(nodes: Sequence[Node]) -> Iterator[dict[str, Any]]:
    for verbs, messages in _PASSING:
        keys = [key for node in nodes for verb in verbs for key in getattr(node, verb)]
        yield _allow(f"{Link.ROUTER.value} {' '.join(verbs)}", _BOTH, messages, keys)
    yield _allow(f"{Link.ROUTER.value} is there", _BOTH, _ASKING, [router_key()])


def _edge_rules(nodes: Sequence[Node]) -> Iterator[dict[str, Any]]:
    """Yield what people and their gateways may do here themselves, and that they are told who answers."""
    yield from rules_of(Link.EDGE.value, nodes)
    yield _allow(f"{Link.EDGE.value} is there", _BOTH, _ASKING, [router_key()])
    asked = [key for node in nodes for key in node.asks]
    yield _allow(f"{Link.EDGE.value} finds", ("egress",), ("declare_queryable",), asked)


def _allow(name: str, flows: Sequence[str], messages: Sequence[str], keys: Iterable[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": list(dict.fromkeys(keys)),
    }
