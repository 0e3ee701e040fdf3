"""Who runs, and what each role says and hears on the bus: the system as data.

compose.yaml and the access control of the router are made from, or checked against, this one table.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from protocol.keys import Keys

CROWD = "-crowd"
"""How the deployment of a crowd is called after that of its learner."""
OPERATOR = "operator"
"""The name under which the command line controls a session; nobody can teach under it."""


class Role(Enum):
    """Roles of processes on the bus."""

    ROUTER = "router"
    ENVIRONMENT = "environment"
    LEARNER = "learner"
    MONITOR = "monitor"
    TEACHER = "teacher"
    WORKER = "worker"
    GATEWAY = "gateway"
    AGGREGATOR = "aggregator"
    OPERATOR = "operator"
    STUDY = "study"


@dataclass(frozen=True, slots=True)
class Node:
    """One role: the key expressions it may use, by verb of the bus."""

    role: Role
    purpose: str
    publishes: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    serves: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    announces: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()
    asks_not: tuple[str, ...] = ()
    """What `asks` would include, and this role may not ask."""


def teaching_role(deployment: str) -> Role:
    """Return as whom somebody teaches: a crowd's members are its workers."""
    return Role.WORKER if deployment.endswith(CROWD) else Role.TEACHER


def topology(keys: Keys, crowd: Keys | None = None) -> tuple[Node, ...]:
    """Return every role of a deployment, in the order in which processes start.

    Args: crowd: the keys of its crowd, a deployment of its own where an aggregator stands for the learner.
    """
    crowd = crowd or Keys(f"{keys.deployment}{CROWD}")
    return (
        Node(Role.ROUTER, "carries all messages; every other process is its client"),
        *_services(keys),
        _aggregator(keys, crowd),
        *_people(keys, crowd),
        *_programs(keys, crowd),
    )


def _aggregator(keys: Keys, crowd: Keys) -> Node:
    about = ("list", "show")
    return Node(
        Role.AGGREGATOR,
        "a teacher to the learner, a learner to its crowd: weighs many answers into one",
        publishes=(crowd.decision(), crowd.measures(), keys.crowd()),
        subscribes=(keys.decision(), keys.measures()),
        serves=(
            *(crowd.answer(), crowd.join(), crowd.control(), keys.status("aggregator")),
            *(crowd.learner(verb) for verb in about),
        ),
        asks=(
            *(keys.join(), keys.answer(), keys.status("aggregator")),
            *(keys.learner(verb) for verb in about),
        ),
        announces=(keys.presences(), keys.service("aggregator")),
        watches=(crowd.presences(),),
    )


def _services(keys: Keys) -> tuple[Node, ...]:
    worlds = (keys.environment("begin"), keys.environment("execute"))
    sessions = tuple(keys.learner(verb) for verb in ("create", "branch", "list", "show", "rows"))
    return (
        Node(
            Role.ENVIRONMENT,
            "owns the worlds and executes actions, exactly once a decision",
            serves=(*worlds, keys.status("environment")),
            asks=(keys.status("environment"),),
            announces=(keys.service("environment"),),
        ),
        Node(
            Role.LEARNER,
            "owns sessions and their journal, opens decisions, acknowledges answers",
            publishes=(keys.decision(), keys.measures()),
            serves=(keys.answer(), keys.join(), keys.control(), *sessions, keys.status("learner")),
            asks=(*worlds, keys.status("learner")),
            announces=(keys.service("learner"),),
            watches=(keys.presences(), keys.service("learner")),
        ),
    )


def _people(keys: Keys, crowd: Keys) -> tuple[Node, ...]:
    return (
        Node(
            Role.TEACHER,
            "sees decisions and answers them",
            subscribes=_news(keys),
            asks=(keys.join(), keys.answer(), keys.control()),
            asks_not=(keys.control(teacher=OPERATOR),),
            announces=(keys.presences(),),
        ),
        Node(
            Role.WORKER,
            "a member of the crowd: sees its aggregator's decisions and answers them",
            subscribes=_news(crowd),
            asks=(crowd.join(), crowd.answer()),
            announces=(crowd.presences(),),
        ),
        Node(
            Role.OPERATOR,
            "the command line: creates, lists, shows and controls sessions",
            subscribes=_news(keys),
            asks=(
                keys.learner("create"),
                keys.learner("branch"),
                keys.learner("list"),
                keys.learner("show"),
                keys.control(teacher=OPERATOR),
                keys.status(),
                crowd.status("gateway"),
            ),
            watches=(keys.service(), crowd.service("gateway")),
        ),
    )


def _programs(keys: Keys, crowd: Keys) -> tuple[Node, ...]:
    return (
        Node(
            Role.MONITOR,
            "draws sessions for remote viewing; may be slow, absent or dead",
            subscribes=(*_news(keys), keys.crowd()),
            serves=(keys.status("monitor"),),
            asks=(*(keys.learner(verb) for verb in ("list", "show", "rows")), keys.status("monitor")),
            announces=(keys.service("monitor"),),
        ),
        Node(
            Role.GATEWAY,
            "serves the teaching page, and is a teacher or worker for everybody who has it open",
            subscribes=(*_news(keys), *_news(crowd)),
            serves=(keys.status("gateway"), crowd.status("gateway")),
            asks=(
                *(keys.join(), keys.answer(), keys.status("gateway")),
                *(crowd.join(), crowd.answer(), crowd.status("gateway")),
            ),
            announces=(
                keys.presences(),
                keys.service("gateway"),
                crowd.presences(),
                crowd.service("gateway"),
            ),
        ),
        Node(
            Role.STUDY,
            "a gateway that leads people through a study, and creates the session of each",
            subscribes=_news(keys),
            asks=(
                keys.join(),
                keys.answer(),
                keys.learner("create"),
                keys.control(teacher=OPERATOR),
                keys.status("gateway"),
            ),
            serves=(keys.status("gateway"),),
            announces=(keys.presences(), keys.service("gateway")),
        ),
    )


def _news(keys: Keys) -> tuple[str, str]:
    return keys.decision(), keys.measures()


def access_control(deployments: Iterable[str], *, tls: bool) -> dict[str, Any]:
    """Return the router's access control: each role may do what its nodes say, and nobody anything else.

    Args: tls: whether a role is also proved by the common name of a certificate.
    """
    merged: dict[Role, list[Node]] = {}
    for deployment in deployments:
        for node in topology(Keys(deployment)):
            merged.setdefault(node.role, []).append(node)
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for role, nodes in merged.items():
        its_own = list(rules_of(role.value, nodes))
        if its_own:
            rules += its_own
            names = {"usernames": [role.value]} | ({"cert_common_names": [role.value]} if tls else {})
            subjects.append({"id": role.value, **names})
            policies.append({"rules": [rule["id"] for rule in its_own], "subjects": [role.value]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


_MESSAGES = (
    # what a role does, towards the router or from it, which messages that takes
    ("publishes", "ingress", ("put",)),
    ("subscribes", "ingress", ("declare_subscriber",)),
    ("subscribes", "egress", ("put",)),
    ("serves", "ingress", ("declare_queryable", "reply")),
    ("serves", "egress", ("query",)),
    ("asks", "ingress", ("query",)),
    ("asks", "egress", ("reply",)),
    ("announces", "ingress", ("liveliness_token",)),
    ("watches", "ingress", ("declare_liveliness_subscriber", "liveliness_query")),
    ("watches", "egress", ("liveliness_token",)),
    ("asks_not", "ingress", ("query",)),
)


def rules_of(subject: str, nodes: Sequence[Node]) -> Iterator[dict[str, Any]]:
    """Yield the rules for a subject that may do what all these nodes say, and not what one may not."""
    for verb, flow, messages in _MESSAGES:
        keys = [key for node in nodes for key in getattr(node, verb)]
        if keys:
            yield {
                "id": f"{subject} {verb} {flow}",
                "permission": "deny" if verb == "asks_not" else "allow",
                "flows": [flow],
                "messages": list(messages),
                "key_exprs": list(dict.fromkeys(keys)),
            }
