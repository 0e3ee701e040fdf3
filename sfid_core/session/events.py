"""Everything that can happen to a session. Frozen, journaled before they take effect.

The two that come with every step are named tuples, which are made three times faster than frozen dataclasses.
"""

from dataclasses import dataclass
from typing import NamedTuple

from sfid_core.outcome import Outcome
from sfid_core.session.config import Window
from sfid_core.teaching.answers import Answer


@dataclass(frozen=True, slots=True)
class TeacherJoined:
    """A teacher is present."""

    teacher: str


@dataclass(frozen=True, slots=True)
class TeacherLeft:
    """A teacher is gone; what they have answered stays."""

    teacher: str


@dataclass(frozen=True, slots=True)
class EpisodeBegan:
    """The environment stands at the start of an episode."""

    episode: int
    state: bytes
    view: str
    """The state as teachers see it (Sokoban: XSB text)."""
    optimal_steps: int | None
    """Fewest steps from here; None where no exact solver reaches."""


class AnswerGiven(NamedTuple):
    """A teacher's answer arrived, for the first time under this id."""

    teacher: str
    answer_id: bytes
    decision: int
    state: bytes
    """The state it was given for: an answer is bound to what the teacher saw."""
    answer: Answer


@dataclass(frozen=True, slots=True)
class WindowElapsed:
    """The deadline that the session asked for has passed."""


class StepTaken(NamedTuple):
    """The environment executed the action of a decision."""

    decision: int
    reward: float
    outcome: Outcome
    state: bytes
    view: str
    distance: int = -1
    """Fewest steps from the new state to solved; -1 where there is no way or nobody knows."""
    action: int = -1
    """What was executed, where the table would choose otherwise now because answers were erased; -1: what
    the session chose."""
    undone: int = -1
    """Whether it was taken back then (1) or not (0), where answers were erased; -1: the session decides."""


@dataclass(frozen=True, slots=True)
class WindowChanged:
    """The window is another from now on; an open window is measured anew from its opening."""

    by: str
    window: Window


@dataclass(frozen=True, slots=True)
class Paused:
    """Hold the count-down and the next decision."""

    by: str


@dataclass(frozen=True, slots=True)
class Resumed:
    """Go on from a pause."""

    by: str


@dataclass(frozen=True, slots=True)
class Stopped:
    """End the session here; what was learnt is kept."""

    by: str


@dataclass(frozen=True, slots=True)
class Restarted:
    """A learner process took the session up, at its creation too; windows open anew: a clock dies with it."""

    epoch: int


Event = (
    TeacherJoined
    | TeacherLeft
    | EpisodeBegan
    | AnswerGiven
    | WindowElapsed
    | StepTaken
    | WindowChanged
    | Paused
    | Resumed
    | Stopped
    | Restarted
)
