"""What a teacher of one's own needs: join a session, see its decisions, answer, know what became of it.

    with join("tcp/127.0.0.1:7447", "s1", "ann") as teaching:
        for decision in teaching.decisions():
            teaching.answer(decision, action="UP")

`Client` is the same without a loop of its own: `next` hands out one Update after another on the caller's
thread, and what has to be repeated (joining, unacknowledged answers) is repeated while `next` runs.
"""

from services.client.client import Client
from services.client.teaching import Teaching, TeachingError, join
from services.client.updates import (
    AnswerState,
    AnswerUpdate,
    Connection,
    Controlled,
    EpisodeOver,
    Learnt,
    Opened,
    Refused,
    Update,
    Welcomed,
)

__all__ = [
    "AnswerState",
    "AnswerUpdate",
    "Client",
    "Connection",
    "Controlled",
    "EpisodeOver",
    "Learnt",
    "Opened",
    "Refused",
    "Teaching",
    "TeachingError",
    "Update",
    "Welcomed",
    "join",
]
