"""`sfid`: Shaping from Interactive Demonstrations, Algorithm 2 of Raza, Johnston & Williams 2016."""

from collections.abc import Iterable

from sfid_core.learning.method import Verdict
from sfid_core.learning.q_learner import QLearner
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import merge_labels


def omega(label: int | None, action: int) -> float:
    """Return the paper's Omega: +1 where the label names the action, -1 where another, 0 for silence."""
    if label is None:
        return 0.0
    return 1.0 if label == action else -1.0


class SfID(QLearner):
    """Ask for the teacher's action in the frozen state, act as chosen regardless, learn from r + Omega."""

    asks = AnswerKind.LABEL

    def judge(self, action: int, answers: Iterable[Answer]) -> Verdict:
        """Return Omega of the merged label."""
        label = merge_labels(answers)
        return Verdict(omega(label, action), label)
