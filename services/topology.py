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


def topology(keys: Keys, crowd: Keys | None = None) -> tuple[Node, ...]:
    """Return every role of a deployment, in the order in which processes start.

    Args: crowd: the keys of its crowd, a deployment of its own where an aggregator stands for the learner.
    """
    crowd = crowd or Keys(f"{keys.deployment}-crowd")
    return (
        Node(Role.ROUTER, "carries all messages; every other process is its client"),
        *_services(keys),
        _aggregator(keys, crowd),
        *_clients(keys),
    )


def _aggregator(keys: Keys, crowd: Keys) -> Node:
    about = ("list", "show")
    return Node(
        Role.AGGREGATOR,
        "a teacher to the learner, a learner to its crowd: weighs many answers into one",
        publishes=(crowd.decision(), crowd.measures(), keys.crowd()),
        subscribes=(keys.decision(), keys.measures()),
        serves=(crowd.answer(), crowd.join(), crowd.control(), *(crowd.learner(verb) for verb in about)),
        asks=(keys.join(), keys.answer(), *(keys.learner(verb) for verb in about)),
        announces=(keys.present(), keys.service("aggregator")),
        watches=(crowd.present(),),
    )


def _services(keys: Keys) -> tuple[Node, ...]:
    worlds = (keys.environment("begin"), keys.environment("execute"))
    sessions = tuple(keys.learner(verb) for verb in ("create", "list", "show", "rows"))
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
            subscribes=(*news, keys.crowd()),
            asks=(keys.learner("list"), keys.learner("show"), keys.learner("rows")),
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
        Node(
            Role.STUDY,
            "a gateway that leads people through a study, and creates the session of each",
            subscribes=news,
            asks=(
                keys.join(),
                keys.answer(),
                keys.learner("create"),
                keys.control(teacher="operator"),
            ),
            announces=(keys.present(), keys.service("gateway")),
        ),
    )
