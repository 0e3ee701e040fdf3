"""The state of a session, changed by `machine.advance` and by nothing else."""

from dataclasses import dataclass, field
from enum import Enum

from sfid_core.learning.method import Method, Verdict
from sfid_core.learning.methods import make_method
from sfid_core.session.config import SessionConfig, Window
from sfid_core.session.events import StepTaken
from sfid_core.session.measures import EpisodeMeasures, EpisodeTally, LabelCounts
from sfid_core.teaching.answers import Answer


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


@dataclass(slots=True)
class Given:
    """An answer that waits in the open window."""

    answer_id: bytes
    answer: Answer


@dataclass(slots=True)
class Session:
    """A session between two events. Times are ns on the owner's steady clock."""

    config: SessionConfig
    method: Method
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
    action: int = 0
    opened_at_ns: int = 0
    asked_at_ns: int = 0
    deadline_ns: int | None = None
    """When the shell must send WindowElapsed; None means no timer is wanted."""
    elapsed_ns: int = 0
    """How much of the window had passed when the pause began."""
    answers: dict[str, Given] = field(default_factory=dict)
    """The answers of the open window by teacher; the last one of each counts."""
    verdict: Verdict | None = None
    transition: StepTaken | None = None
    """What the environment answered, while teachers judge it."""
    deadlines_ns: dict[int, int | None] = field(default_factory=dict)
    """Deadlines of the latest decisions, to tell superseded answers from late ones; None: no deadline."""
    tally: EpisodeTally = field(default_factory=EpisodeTally)
    episodes: list[EpisodeMeasures] = field(default_factory=list)
    counts: LabelCounts = field(default_factory=LabelCounts)
    teaching_ns: int = 0
    """Time from the opening of decisions to their update, summed: pauses between decisions and down-time are
    left out."""


def new_session(config: SessionConfig, actions: int = 4) -> Session:
    """Return a session before its first event.

    Raises: ParameterError when the method is unknown.
    """
    method = make_method(config.method, actions, config.parameters, config.seed, config.session)
    return Session(config, method, config.window)
