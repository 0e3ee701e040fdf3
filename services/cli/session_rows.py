"""The rows of `sfid session list`: which ones, in which order, and how many of what."""

from collections import Counter
from collections.abc import Sequence
from enum import Enum
from typing import Annotated

import typer

from protocol.messages import SessionList, SessionSummary
from protocol.session_union import untold

SHARDS_NAMED = 8
"""Absent shards that are named one by one."""


class State(Enum):
    """How a session stands, in the words of the list."""

    GATHERING = "gathering"
    BEGINNING = "beginning"
    READY = "ready"
    ASKING = "asking"
    EXECUTING = "executing"
    PAUSED = "paused"
    FINISHED = "finished"


Match = Annotated[str | None, typer.Option(help="Only sessions whose name has this text in it.")]
StateFlag = Annotated[State | None, typer.Option("--state", help="Only sessions that stand so.")]


def state_of(row: SessionSummary) -> str:
    """Return how a session stands."""
    return State.PAUSED.value if row.paused else row.phase


def listed(rows: Sequence[SessionSummary], match: str | None, state: State | None) -> list[SessionSummary]:
    """Return the rows asked for, by name: learners answer in any order."""
    chosen = [
        row
        for row in rows
        if (match is None or match in row.session) and (state is None or state_of(row) == state.value)
    ]
    return sorted(chosen, key=lambda row: row.session)


def counted(rows: Sequence[SessionSummary], total: int) -> str:
    """Return the line below the list: how many there are, of how many, and how they stand."""
    of = f"{len(rows)} of " if len(rows) != total else ""
    states = Counter(map(state_of, rows))
    more = ", ".join(f"{states[one.value]} {one.value}" for one in State if states[one.value])
    return f"{of}{total} session{'s' if total != 1 else ''}{': ' if more else ''}{more}"


def lacking(whole: SessionList, status: str) -> str | None:
    """Return the line about the shards that may have more sessions than were told, None where there are none.

    Such a shard has answered nothing, or not to its last page.

    Args: status: the command that shows how the learners do.
    """
    absent = untold(whole)
    if not absent:
        return None
    named = ", ".join(f"shard-{shard}" for shard in absent[:SHARDS_NAMED])
    more = f" and {len(absent) - SHARDS_NAMED} more" if len(absent) > SHARDS_NAMED else ""
    return (
        f"the list is not whole: {named}{more} of {whole.shards} shard{'s' if whole.shards != 1 else ''} "
        f"did not answer to the end; {status} tells how each does: "
        "start the absent learner, or end the one that hangs"
    )
