"""`reward`: interactive reward shaping, Algorithm 1 of Raza, Johnston & Williams 2016."""

from sfid_core.compiled import kernel
from sfid_core.learning.choices import choose_explored
from sfid_core.learning.kernels import Evidence, Learned, Memory, Transition, one_step
from sfid_core.learning.method import Method
from sfid_core.learning.q_learning import QLearningParameters
from sfid_core.teaching.answers import AnswerKind


@kernel
def learn(m: Memory, p: QLearningParameters, t: Transition, e: Evidence) -> Learned:
    """Move Q(s, a) by the TD error of r + h, h being what the teacher gave for the action (Eq. 4)."""
    return one_step(m, p.alpha, p.gamma, t, e.reward)


REWARD = Method(
    name="reward",
    summary="interactive reward shaping: the teacher judges the action that was seen",
    source="Raza, Johnston & Williams 2016, Algorithm 1",
    parameters=QLearningParameters,
    learn=learn,
    choose=choose_explored,
    asks_after=AnswerKind.REWARD,
)
