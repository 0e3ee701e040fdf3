"""`reward`: interactive reward shaping, Algorithm 1 of Raza, Johnston & Williams 2016."""

from collections.abc import Iterable

from sfid_core.learning.method import Verdict
from sfid_core.learning.q_learner import QLearner
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import merge_rewards


class RewardShaping(QLearner):
    """Act, let the teacher judge what was seen, learn from r + h."""

    asks = AnswerKind.REWARD

    def judge(self, action: int, answers: Iterable[Answer]) -> Verdict:  # noqa: ARG002 - the reward judges it already
        """Return the merged reward as h; silence is 0."""
        return Verdict(merge_rewards(answers) or 0.0)
