"""`q-learning`: the agent without a teacher."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import choose_explored
from sfid_core.learning.kernels import Evidence, Learned, Memory, Transition, one_step
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ALPHA, GAMMA, RATE


class QLearningParameters(NamedTuple):
    """Parameters of greedy tabular Q-learning."""

    alpha: Annotated[float, ALPHA] = 0.1
    """Step size."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor."""
    explore: Annotated[float, RATE] = 0.0
    """epsilon: probability of a random action; the founding paper has none."""


@kernel
def learn(m: Memory, p: QLearningParameters, t: Transition, e: Evidence) -> Learned:  # noqa: ARG001 - asks nobody
    """Move Q(s, a) by the TD error of the environment's reward (Eq. 2)."""
    return one_step(m, p.alpha, p.gamma, t, 0.0)


Q_LEARNING = Method(
    name="q-learning",
    summary="no teacher: greedy tabular Q-learning from the environment's reward",
    source="Watkins & Dayan 1992; Raza, Johnston & Williams 2016, Eq. 1 and 2",
    parameters=QLearningParameters,
    learn=learn,
    choose=choose_explored,
)
