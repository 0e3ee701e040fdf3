"""Everything a session can ask its shell to do: records, never callables."""

from enum import Enum
from typing import Literal, cast

from sfid_core.record import record
from sfid_core.session.measures import EpisodeMeasures, StepMeasures

CodeWord = Literal["accepted", "superseded", "late", "rejected", "conflict"]


class AnswerCode(Enum):
    """What became of an answer, as told to its teacher; all but REJECTED and CONFLICT mean: saved."""

    ACCEPTED = "accepted"
    """In time: it counts, unless the same teacher answers again before the window closes."""
    SUPERSEDED = "superseded"
    """After the close but before the deadline: kept, not applied."""
    LATE = "late"
    """After the deadline: kept, not applied."""
    REJECTED = "rejected"
    """Not an answer to what was asked; the reason says why."""
    CONFLICT = "conflict"
    """The same id came before with another content."""

    def __init__(self, word: str) -> None:
        self.word = cast("CodeWord", word)
        """The value, as a plain attribute: read at every answer, where `value` costs a call."""


@record
class BeginEpisode:
    """Ask the environment for the start of this episode."""

    episode: int


@record
class Execute:
    """Ask the environment to execute the action of this decision, exactly once."""

    decision: int
    action: int


@record
class Acknowledge:
    """Tell the teacher what became of the answer, once it is durable."""

    answer_id: bytes
    code: AnswerCode
    reason: str = ""


@record
class Announce:
    """Publish the decision as it stands: opened, closed, paused, or with other teachers."""


@record
class StepDone:
    """Publish the measures of a learnt step."""

    measures: StepMeasures


@record
class EpisodeDone:
    """Publish the measures of a finished episode."""

    measures: EpisodeMeasures


@record
class SessionDone:
    """The session has ended; note the digest of what was learnt."""


@record
class Ignored:
    """The event was not legal here and changed nothing."""

    reason: str


Effect = BeginEpisode | Execute | Acknowledge | Announce | StepDone | EpisodeDone | SessionDone | Ignored
