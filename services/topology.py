"""Who runs, and what each role says and hears on the bus: the system as data.

compose.yaml, the supervisor and the access control of the router are made from, or checked against, this one
table.
"""

from dataclasses import dataclass
from enum import Enum

from protocol.keys import Keys


class Role(Enum):
    """Roles of processes on the bus."""

    ROUTER = "router"
    ENVIRONMENT = "environment"
    LEARNER = "learner"
    MONITOR = "monitor"
    TEACHER = "teacher"
    GATEWAY = "gateway"
    OPERATOR = "operator"


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


def topology(keys: Keys) -> tuple[Node, ...]:
    """Return every role of a deployment, in the order in which processes start."""
    return (
        Node(Role.ROUTER, "carries all messages; every other process is its client"),
        *_services(keys),
        *_clients(keys),
    )


def _services(keys: Keys) -> tuple[Node, ...]:
    worlds = (keys.environment("begin"), keys.environment("execute"))
    sessions = (keys.learner("create"), keys.learner("list"), keys.learner("show"))
    return (
        Node(
            Role.ENVIRONMENT,
            "owns the worlds and executes actions, exactly once a decision",
            serves=worlds,
            announces=(keys.service("environment"),),
        ),
        Node(
            Role.LEARNER,
            "owns sessions and their journal, opens decisions, acknowledges answers",
            publishes=(keys.decision(), keys.measures()),
            serves=(keys.answer(), keys.join(), keys.control(), *sessions),
            asks=worlds,
            announces=(keys.service("learner"),),
            watches=(keys.present(),),
        ),
    )


def _clients(keys: Keys) -> tuple[Node, ...]:
    news = (keys.decision(), keys.measures())
    return (
        Node(
            Role.MONITOR,
            "draws sessions for remote viewing; may be slow, absent or dead",
            subscribes=news,
            asks=(keys.learner("list"), keys.learner("show")),
        ),
        Node(
            Role.TEACHER,
            "sees decisions and answers them",
            subscribes=news,
            asks=(keys.join(), keys.answer(), keys.control()),
            announces=(keys.present(),),
        ),
        Node(
            Role.GATEWAY,
            "serves the teaching page, and is a teacher for everybody who has it open",
            subscribes=news,
            asks=(keys.join(), keys.answer()),
            announces=(keys.present(), keys.service("gateway")),
        ),
        Node(
            Role.OPERATOR,
            "the command line: creates, lists, shows and controls sessions",
            subscribes=news,
            asks=(
                keys.learner("create"),
                keys.learner("list"),
                keys.learner("show"),
                keys.control(teacher="operator"),
            ),
        ),
    )
