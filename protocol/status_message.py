"""What a service says of itself when it is asked how it does; see messages.py for what all messages share.

This is between the services of one deployment and whoever runs it: teachers neither need nor may ask it.
"""

from typing import Annotated

from msgspec import Meta, field

from protocol.fields import Count, Name, Text
from protocol.messages import LabelTotals, Wire

COMMIT_BOUNDS_US = (250, 500, 1_000, 2_000, 5_000, 10_000, 50_000, 250_000, 1_000_000)
"""Upper bounds of the histogram of commits in microseconds; a last bin holds what took longer."""

NO_LABELS = LabelTotals(
    submitted=0, acknowledged=0, applied=0, superseded=0, late=0, rejected=0, pending=0
)  # fmt: skip


class ServiceStatus(Wire, frozen=True, kw_only=True, tag="service-status"):
    """How a service does; the answer comes from its loop, so a service that hangs does not give it."""

    role: Name
    name: Name
    version: Text
    """Of the program."""
    pid: Count
    uptime_ms: Count
    ready: bool = True
    reason: Text = ""
    """Why it is not ready; empty when it is."""
    backlog: Count = 0
    """Messages that wait for its loop."""
    sessions: Count = 0
    """Sessions it has, finished ones too."""
    running: Count = 0
    """Of these, those that are not finished."""
    shards: Count = 0
    """Of a learner: in how many shards the sessions of its deployment lie, each with a learner."""
    teachers: Count = 0
    """Who is present, over all sessions (at a gateway or an aggregator: people)."""
    labels: LabelTotals = NO_LABELS
    """What became of all answers in its journal."""
    refused: Annotated[dict[Text, Count], Meta(max_length=64)] = field(default_factory=dict)
    """Messages refused since it started, by reason of a closed list."""
    commits: Annotated[tuple[Count, ...], Meta(max_length=16)] = ()
    """Commits since it started, by how long they took: see COMMIT_BOUNDS_US."""
    commit_us: Count = 0
    """Time that all of them took together, in microseconds."""
    last_commit_ms: Count | None = None
    """Time since the last commit; null before the first."""
