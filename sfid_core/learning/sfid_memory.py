"""`sfid-memory`: SfID that remembers labels, for a label tells about every action of its state."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import choose_explored
from sfid_core.learning.kernels import Evidence, Learned, Memory, Transition, one_step
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ALPHA, GAMMA, RATE, Choice
from sfid_core.learning.sfid import OMEGA, omega
from sfid_core.teaching.answers import AnswerKind

SHAPED = 1


class SfIDMemoryParameters(NamedTuple):
    """Parameters of SfID with label memory (ours)."""

    alpha: Annotated[float, ALPHA] = 0.1
    """Step size."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of Q; of the measures alone where no Q is learnt."""
    omega: Annotated[int, OMEGA] = 0
    """What an action earns that the label names with probability q, of K actions: 2 q - 1 (graded: the
    paper's +1 and -1), (K q - 1) / (K - 1) (centred), or q - 1, never above 0 (penalty, ours)."""
    policy: Annotated[int, Choice(("model", "shaped"))] = 0
    """What is learnt and acted on: what each action of a state earns by its labels, without the environment's
    rewards (model), or Q, which in silence earns what the latest label of the state says (shaped). Ours."""
    keep: Annotated[float, RATE] = 1.0
    """What is left of the memory of a state after each silent step in it; 1 never forgets."""
    explore: Annotated[float, RATE] = 0.0
    """epsilon: probability of a random action; the founding paper has none."""


@kernel
def learn(m: Memory, p: SfIDMemoryParameters, t: Transition, e: Evidence) -> Learned:
    """Learn from a step, and from its label about all actions of its state."""
    if p.policy == SHAPED:
        return shaped_step(m, p, t, e)
    return model_step(m, p, t, e)


@kernel
def model_step(m: Memory, p: SfIDMemoryParameters, t: Transition, e: Evidence) -> Learned:
    """Move H(s, b) of every action b by alpha * (Omega(a_b, b) - H(s, b)), and act argmax H.

    A model looks one step ahead: no circuit of rewards can grow in it, and no reward of the environment
    enters. Both errors of the result are Omega(a_b, a) - H(s, a) of the action taken; 0 in silence.
    """
    at = t.state * m.width
    if not e.given:
        fade(m, at, p.keep)
        return Learned(0.0, 0.0, 0.0)
    h = omega(p.omega, e.belief[t.action], m.actions)
    error = h - m.values[at + t.action]
    for action in range(m.actions):
        agreement = omega(p.omega, e.belief[action], m.actions)
        m.values[at + action] += p.alpha * (agreement - m.values[at + action])
    m.values[at + m.width - 1] += 1.0
    return Learned(error, error, h)


@kernel
def shaped_step(m: Memory, p: SfIDMemoryParameters, t: Transition, e: Evidence) -> Learned:
    """Move Q(s, a) by the TD error of r + h, and act argmax Q.

    h is Omega(a_b, a), in silence that of the latest label of the state, for any action of it, as far as it
    is kept; 0 in a state never labelled.
    """
    at = t.state * m.width + m.actions
    if e.given:
        for action in range(m.actions):
            m.values[at + action] = omega(p.omega, e.belief[action], m.actions)
    else:
        fade(m, at, p.keep)
    return one_step(m, p.alpha, p.gamma, t, m.values[at + t.action])


@kernel
def fade(m: Memory, at: int, keep: float) -> None:
    """Weaken the numbers of all actions from `at` on."""
    for action in range(m.actions):
        m.values[at + action] *= keep


SFID_MEMORY = Method(
    name="sfid-memory",
    summary="SfID that learns from each label about every action of the state, and remembers it in silence",
    source="extends Raza, Johnston & Williams 2016, Algorithm 2 (ours)",
    parameters=SfIDMemoryParameters,
    learn=learn,
    choose=choose_explored,
    asks_before=AnswerKind.LABEL,
    blocks=2,
)
