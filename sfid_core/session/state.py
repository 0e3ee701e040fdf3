"""The state of a session, changed by `machine.advance` and by nothing else."""

from dataclasses import dataclass, field
from enum import Enum

from sfid_core.learning.kernels import Evidence
from sfid_core.learning.learner import Learner, learner_draws
from sfid_core.learning.methods import method_named
from sfid_core.record import record
from sfid_core.session.config import SessionConfig, Window
from sfid_core.session.deadlines import Deadlines
from sfid_core.session.episodes import EpisodeLog
from sfid_core.session.events import StepTaken
from sfid_core.session.measures import EpisodeTally, LabelCounts
from sfid_core.teaching.answers import Answer, AnswerKind


class Phase(Enum):
    """Where a session is in its round."""

    GATHERING = "gathering"
    """Waits for the first teachers."""
    BEGINNING = "beginning"
    """Waits for the environment to begin an episode."""
    READY = "ready"
    """Paused between two decisions."""
    ASKING = "asking"
    """The window is open."""
    EXECUTING = "executing"
    """Waits for the environment to execute the action."""
    FINISHED = "finished"


@record
class Given:
    """An answer that waits in the open window."""

    answer: Answer
    at_ns: int


@dataclass(slots=True)
class Session:
    """A session between two events. Times are ns on the owner's steady clock."""

    config: SessionConfig
    learner: Learner
    gamma: float
    """Discount factor of the measures."""
    window: Window
    epoch: int = 1
    phase: Phase = Phase.GATHERING
    paused: bool = False
    teachers: set[str] = field(default_factory=set)
    decision: int = 0
    """Running number of the decision over the whole session, from 0."""
    episode: int = 0
    step: int = 0
    state: bytes = b""
    view: str = ""
    optimal_steps: int | None = None
    """Fewest steps from the start of the episode."""
    distance: int = -1
    """Fewest steps from the state; -1 where there is no way or nobody knows."""
    action: int = 0
    """Index of the action; the number of actions itself stands for taking the last step back."""
    undo_due: bool = False
    """The next decision takes the last step back."""
    opened_at_ns: int = 0
    asked_at_ns: int = 0
    deadline_ns: int | None = None
    """When the shell must send WindowElapsed; None means no timer is wanted."""
    elapsed_ns: int = 0
    """How much of the window had passed when the pause began."""
    uncounted_ns: int = 0
    """How much of that had passed when its span began to count anew."""
    answers: dict[str, Given] = field(default_factory=dict)
    """The answers of the open window by teacher; the last one of each counts."""
    given: tuple[tuple[str, Answer], ...] = ()
    """(teacher, answer) of the windows of this decision that have closed."""
    evidence: Evidence | None = None
    """What the answers of the closed window come to."""
    transition: StepTaken | None = None
    """What the environment answered, while teachers judge it."""
    deadlines: Deadlines = field(default_factory=Deadlines)
    tally: EpisodeTally = field(default_factory=EpisodeTally)
    episodes: EpisodeLog = field(default_factory=EpisodeLog)
    counts: LabelCounts = field(default_factory=LabelCounts)
    teaching_ns: int = 0
    """Time from the opening of decisions to their update, summed: pauses between decisions and down-time are
    left out."""

    @property
    def asks(self) -> AnswerKind | None:
        """What teachers are asked, now or at the next window of this decision."""
        method = self.learner.method
        if method.asks_before is None or self.transition is not None:
            return method.asks_after
        return method.asks_before

    def standing_answers(self) -> tuple[tuple[tuple[str, Answer], ...], int]:
        """Return the answers of the window by teacher, and when the first came (none: when it was asked)."""
        waiting = self.answers
        if len(waiting) == 1:  # nearly always
            ((teacher, given),) = waiting.items()
            return ((teacher, given.answer),), given.at_ns
        first_ns = min([given.at_ns for given in waiting.values()], default=self.asked_at_ns)
        return tuple([(teacher, waiting[teacher].answer) for teacher in sorted(waiting)]), first_ns


def new_session(config: SessionConfig, actions: int = 4) -> Session:
    """Return a session before its first event.

    Raises: ParameterError when the method is unknown.
    """
    parameters = config.method_parameters
    learner = Learner(
        method_named(config.method),
        parameters,
        actions,
        learner_draws(config.seed, config.session),
        config.world.steps_max,
    )
    return Session(config, learner, parameters.gamma, config.window)
