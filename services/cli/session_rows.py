"""The rows of `sfid session list`: which ones, in which order, and how many of what."""

from collections import Counter
from collections.abc import Sequence
from enum import Enum
from typing import Annotated

import typer

from protocol.messages import SessionSummary


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
