"""What a client tells its teacher: one frozen class for each thing that can happen."""

from dataclasses import dataclass
from enum import Enum

from protocol.messages import Acknowledgement, Decision, Episode, Step, Welcome


class AnswerState(Enum):
    """What is known about an answer."""

    SENDING = "sending"
    RETRYING = "retrying"
    """Not acknowledged yet: sent again after a wait."""
    SAVED = "saved"
    """On the learner's disk, and counted in its window."""
    TOO_LATE = "too_late"
    """Kept by the learner, but its window had closed."""
    REJECTED = "rejected"


@dataclass(frozen=True, slots=True)
class Opened:
    """The decision as it stands, newer than every one before; `remaining_ms` counts from `received_ns`."""

    decision: Decision
    received_ns: int


@dataclass(frozen=True, slots=True)
class Learnt:
    """The agent has learnt from a step."""

    step: Step


@dataclass(frozen=True, slots=True)
class EpisodeOver:
    """An episode has ended."""

    episode: Episode


@dataclass(frozen=True, slots=True)
class AnswerUpdate:
    """Something changed about an answer; `attempts` counts the sendings, `reason` is one line or empty."""

    answer_id: bytes
    state: AnswerState
    acknowledgement: Acknowledgement | None = None
    attempts: int = 1
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Controlled:
    """A change of the window, a pause, a resume or a stop was carried out, or was not: `reason` says why."""

    verb: str
    ok: bool
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Connection:
    """Whether the learner can be reached; `detail` is one line for people."""

    connected: bool
    detail: str


@dataclass(frozen=True, slots=True)
class Welcomed:
    """The teacher takes part (again)."""

    welcome: Welcome


@dataclass(frozen=True, slots=True)
class Refused:
    """The learner does not let the teacher join; when `final`, waiting alone will not change that."""

    code: str
    reason: str
    final: bool


Update = Opened | Learnt | EpisodeOver | AnswerUpdate | Controlled | Connection | Welcomed | Refused


def measured(message: Step | Episode) -> Learnt | EpisodeOver:
    """Return a learner's news as an update."""
    return Learnt(message) if isinstance(message, Step) else EpisodeOver(message)
