"""The founding paper's measures, per step, per episode and per session."""

from dataclasses import dataclass

from sfid_core.learning.kernels import Learned
from sfid_core.outcome import Outcome
from sfid_core.record import record
from sfid_core.teaching.answers import Answer


@record
class StepMeasures:
    """One learnt step, whole: what was seen, said, done and learnt."""

    decision: int
    episode: int
    step: int
    state: bytes
    view: str
    action: int
    answers: tuple[tuple[str, Answer], ...]
    """(teacher, answer) by teacher."""
    label: int | None
    reward: float
    learned: Learned
    outcome: Outcome
    next_view: str
    values: tuple[float, ...]
    """The row Q(s, .) after the update."""


@record
class EpisodeMeasures:
    """One episode on the paper's four measures (Figure 2), and what helps to read them."""

    episode: int
    steps: int
    optimal_steps: int | None
    abs_td_error: float
    """Mean over the learnt steps of |delta| of Eq. 2."""
    abs_td_error_shaped: float
    """Mean over the learnt steps of |delta| of Eq. 4."""
    discounted_return: float
    """Sum of gamma^t (r + h)."""
    discounted_env_return: float
    """Sum of gamma^t r."""
    inputs: int
    """Answers applied."""
    agreements: int
    """Labels (or praise) that agreed with the agent."""
    outcome: Outcome


class EpisodeTally:
    """Running sums of one episode; `measures` reads them out."""

    __slots__ = (
        "_abs_env",
        "_abs_shaped",
        "_agreements",
        "_discount",
        "_env_return",
        "_inputs",
        "_learnt",
        "_return",
        "_steps",
    )

    def __init__(self) -> None:
        self._steps = self._learnt = self._inputs = self._agreements = 0
        self._abs_env = self._abs_shaped = self._return = self._env_return = 0.0
        self._discount = 1.0

    def add(self, reward: float, learned: Learned | None, inputs: int, gamma: float) -> None:
        """Count one step; None for one that was taken back, which is a step that nothing is learnt from."""
        discount = self._discount
        self._discount = discount * gamma
        self._steps += 1
        self._env_return += discount * reward
        if learned is None:
            self._return += discount * reward
            return
        environment, shaped, h = learned
        self._learnt += 1
        self._inputs += inputs
        self._agreements += h > 0
        self._abs_env += abs(environment)
        self._abs_shaped += abs(shaped)
        self._return += discount * (reward + h)

    def measures(self, episode: int, optimal_steps: int | None, outcome: Outcome) -> EpisodeMeasures:
        """Return the measures of the episode as it stands; means are 0 before the first step."""
        learnt = max(1, self._learnt)
        return EpisodeMeasures(
            episode,
            self._steps,
            optimal_steps,
            self._abs_env / learnt,
            self._abs_shaped / learnt,
            self._return,
            self._env_return,
            self._inputs,
            self._agreements,
            outcome,
        )


@dataclass(slots=True)
class LabelCounts:
    """What became of all answers of a session, abstentions apart.

    submitted = applied + superseded + late + rejected + pending, at every moment.
    """

    submitted: int = 0
    applied: int = 0
    superseded: int = 0
    late: int = 0
    rejected: int = 0
    pending: int = 0
    """Of the running decision: applied once its step is learnt."""

    @property
    def acknowledged(self) -> int:
        """Answers that were taken: all but the rejected."""
        return self.submitted - self.rejected

    def set_aside(self) -> None:
        """Let the answers to the running decision stay unapplied."""
        self.superseded += self.pending
        self.pending = 0
