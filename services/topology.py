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
        Node(
            Role.ENVIRONMENT,
            "owns the worlds and executes actions, exactly once a decision",
            serves=(keys.environment("begin"), keys.environment("execute")),
            announces=(keys.service("environment"),),
        ),
        Node(
            Role.LEARNER,
            "owns sessions and their journal, opens decisions, acknowledges answers",
            publishes=(keys.decision(), keys.measures()),
            serves=(
                keys.answer(),
                keys.join(),
                keys.control(),
                keys.learner("create"),
                keys.learner("list"),
                keys.learner("show"),
            ),
            asks=(keys.environment("begin"), keys.environment("execute")),
            announces=(keys.service("learner"),),
            watches=(keys.present(),),
        ),
        Node(
            Role.MONITOR,
            "draws sessions for remote viewing; may be slow, absent or dead",
            subscribes=(keys.decision(), keys.measures()),
            asks=(keys.learner("list"), keys.learner("show")),
            announces=(keys.service("monitor"),),
        ),
        Node(
            Role.TEACHER,
            "sees decisions and answers them",
            subscribes=(keys.decision(), keys.measures()),
            asks=(keys.join(), keys.answer(), keys.control()),
            announces=(keys.present(),),
        ),
        Node(
            Role.OPERATOR,
            "the command line: creates, lists, shows and controls sessions",
            subscribes=(keys.decision(), keys.measures()),
            asks=(
                keys.learner("create"),
                keys.learner("list"),
                keys.learner("show"),
                keys.control(teacher="operator"),
            ),
        ),
    )
