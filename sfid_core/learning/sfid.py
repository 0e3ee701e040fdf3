"""`sfid`: Shaping from Interactive Demonstrations, Algorithm 2 of Raza, Johnston & Williams 2016."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import choose_explored
from sfid_core.learning.kernels import Evidence, Learned, Memory, Transition, best, one_step
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ALPHA, GAMMA, RATE, Choice
from sfid_core.teaching.answers import AnswerKind

SKIP = 1
OMEGA = Choice(("graded", "centred", "penalty"))


class SfIDParameters(NamedTuple):
    """Parameters of SfID; the defaults are the founding paper's."""

    alpha: Annotated[float, ALPHA] = 0.1
    """Step size."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor."""
    omega: Annotated[int, OMEGA] = 0
    """What an action earns that the label names with probability q, of K actions: 2 q - 1 (graded: the
    paper's +1 and -1), (K q - 1) / (K - 1) (centred), or q - 1, never above 0 (penalty, ours)."""
    silence: Annotated[int, Choice(("zero", "skip"), source="Raza, Johnston & Williams 2016: zero")] = 0
    """A step without a label: h = 0, or no update. See `sfid-memory` for labels that are remembered."""
    explore: Annotated[float, RATE] = 0.0
    """epsilon: probability of a random action; the founding paper has none."""


@kernel
def omega(form: int, belief: float, actions: int) -> float:
    """Return the agreement with an action that is the teacher's with probability `belief`.

    graded (0): 2 q - 1, which is the paper's Omega of +1 and -1 for a direct label, and its expectation for
    an aggregate. centred (1): (K q - 1) / (K - 1), 0 at total disagreement of K actions. penalty (2): q - 1,
    never above 0, so that no circuit of rewards can pay (ours).
    """
    if form == 0:
        return 2.0 * belief - 1.0
    if form == 1:
        return (actions * belief - 1.0) / (actions - 1.0)
    return belief - 1.0


@kernel
def learn(m: Memory, p: SfIDParameters, t: Transition, e: Evidence) -> Learned:
    """Move Q(s, a) by the TD error of r + Omega(a_b, a); silence is h = 0 (Eq. 4) or no update."""
    if e.given:
        return one_step(m, p.alpha, p.gamma, t, omega(p.omega, e.belief[t.action], m.actions))
    if p.silence == SKIP:
        ahead = 0.0 if t.terminal else best(m, t.next_state)
        environment = t.reward + p.gamma * ahead - m.values[t.state * m.width + t.action]
        return Learned(environment, environment, 0.0)
    return one_step(m, p.alpha, p.gamma, t, 0.0)


SFID = Method(
    name="sfid",
    summary="Shaping from Interactive Demonstrations: agreement with the teacher's action is the reward",
    source="Raza, Johnston & Williams 2016, Algorithm 2",
    parameters=SfIDParameters,
    learn=learn,
    choose=choose_explored,
    asks_before=AnswerKind.LABEL,
)
