"""What an aggregator tells monitors of its crowd; see messages.py for what all messages share."""

from typing import Annotated, Literal

from msgspec import Meta, Struct

from protocol.fields import ActionName, Count, Name, Nanoseconds, Probability
from protocol.messages import Wire


class WorkerReliability(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How often a worker of a crowd is right, as far as the aggregator knows."""

    worker: Name
    mean: Probability
    standard_error: Probability
    labels: Count
    standing: Name
    present: bool


class Crowd(Wire, frozen=True, kw_only=True, tag="crowd"):
    """A crowd as it stands after a decision: what its answers came to, and how reliable its workers are."""

    session: Name
    aggregator: Name
    epoch: Count
    decision: Count
    at_ns: Nanoseconds
    cause: Literal["quorum", "deadline", "overtaken"]
    members: Count
    answered: Count
    action: ActionName | None = None
    posterior: Annotated[dict[ActionName, Probability], Meta(max_length=64)] | None = None
    conclusions: Count
    too_late: Count
    workers: Annotated[tuple[WorkerReliability, ...], Meta(max_length=256)] = ()
