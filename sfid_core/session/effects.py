"""Everything a session can ask its shell to do. Data, never callables.

Those that come with every step are named tuples, which are made three times faster than frozen dataclasses.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Literal, NamedTuple, cast

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


@dataclass(frozen=True, slots=True)
class BeginEpisode:
    """Ask the environment for the start of this episode."""

    episode: int


class Execute(NamedTuple):
    """Ask the environment to execute the action of this decision, exactly once."""

    decision: int
    action: int


class Acknowledge(NamedTuple):
    """Tell the teacher what became of the answer, once it is durable."""

    answer_id: bytes
    code: AnswerCode
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Announce:
    """Publish the decision as it stands: opened, closed, paused, or with other teachers."""


class StepDone(NamedTuple):
    """Publish the measures of a learnt step."""

    measures: StepMeasures


@dataclass(frozen=True, slots=True)
class EpisodeDone:
    """Publish the measures of a finished episode."""

    measures: EpisodeMeasures


@dataclass(frozen=True, slots=True)
class SessionDone:
    """The session has ended; note the digest of what was learnt."""


@dataclass(frozen=True, slots=True)
class Ignored:
    """The event was not legal here and changed nothing."""

    reason: str


Effect = BeginEpisode | Execute | Acknowledge | Announce | StepDone | EpisodeDone | SessionDone | Ignored
