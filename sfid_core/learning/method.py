"""The common interface of all learning methods, and their names."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from sfid_core.learning.q_learning import TDErrors
from sfid_core.learning.q_table import QTable
from sfid_core.teaching.answers import Answer, AnswerKind


class ParameterError(ValueError):
    """A parameter is outside its range; the text is one line with the name, the value and the mend."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters of the tabular methods; the defaults are those of the founding paper."""

    alpha: float = 0.1
    """Step size of Q-learning, in (0, 1]."""
    gamma: float = 0.9
    """Discount factor, in [0, 1)."""

    def __post_init__(self) -> None:
        if not 0 < self.alpha <= 1:
            message = f"alpha {self.alpha} is outside (0, 1]: the founding paper uses 0.1"
            raise ParameterError(message)
        if not 0 <= self.gamma < 1:
            message = f"gamma {self.gamma} is outside [0, 1): the founding paper uses 0.9"
            raise ParameterError(message)


class Verdict(NamedTuple):
    """What the teachers' answers to one decision come to."""

    h: float
    """The teachers' part of the reward; 0 is silence."""
    label: int | None = None
    """The merged label, where labels were asked."""


class Method(Protocol):
    """A learner behind the switch: what it asks, how it acts, what it makes of answers, how it learns."""

    asks: AnswerKind | None
    """What teachers are asked: LABEL before the action, REWARD after it, None for nothing."""
    table: QTable

    def choose(self, state: bytes, counter: int) -> int:
        """Return the action for `state`; `counter` is the decision's number and names every draw."""

    def judge(self, action: int, answers: Iterable[Answer]) -> Verdict:
        """Return what the answers to a decision come to for the action that the agent takes."""

    def learn(self, state: bytes, action: int, reward: float, h: float, next_state: bytes | None) -> TDErrors:
        """Update from one transition; `next_state` is None where it is terminal."""
