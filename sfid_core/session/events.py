"""Everything that can happen to a session: records, journaled before they take effect."""

from sfid_core.outcome import Outcome
from sfid_core.record import record
from sfid_core.session.config import Window
from sfid_core.teaching.answers import Answer


@record
class TeacherJoined:
    """A teacher is present."""

    teacher: str


@record
class TeacherLeft:
    """A teacher is gone; what they have answered stays."""

    teacher: str


@record
class EpisodeBegan:
    """The environment stands at the start of an episode."""

    episode: int
    state: bytes
    view: str
    """The state as teachers see it (Sokoban: XSB text)."""
    optimal_steps: int | None
    """Fewest steps from here; None where no exact solver reaches."""


@record
class AnswerGiven:
    """A teacher's answer arrived, for the first time under this id."""

    teacher: str
    answer_id: bytes
    decision: int
    state: bytes
    """The state it was given for: an answer is bound to what the teacher saw."""
    answer: Answer


@record
class WindowElapsed:
    """The deadline that the session asked for has passed."""


@record
class StepTaken:
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


@record
class WindowChanged:
    """The window is another from now on; an open window is measured anew from its opening."""

    by: str
    window: Window
    afresh: bool = False
    """Whether an open window has its whole span from now: what passed while it had no end does not count.
    Not so in journals of before."""


@record
class Paused:
    """Hold the count-down and the next decision."""

    by: str


@record
class Resumed:
    """Go on from a pause."""

    by: str


@record
class Stopped:
    """End the session here; what was learnt is kept."""

    by: str


@record
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
