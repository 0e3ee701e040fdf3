"""`guide`: the label as a command. The control condition of "label as reward"."""

from sfid_core.compiled import kernel
from sfid_core.learning.choices import choose_explored
from sfid_core.learning.kernels import Draws, Evidence, Learned, Memory, Transition, one_step
from sfid_core.learning.method import Method
from sfid_core.learning.q_learning import QLearningParameters
from sfid_core.teaching.answers import AnswerKind


@kernel
def settle(
    m: Memory,  # noqa: ARG001 - the interface
    p: QLearningParameters,  # noqa: ARG001
    draws: Draws,  # noqa: ARG001
    state: int,  # noqa: ARG001
    action: int,
    e: Evidence,
    decision: int,  # noqa: ARG001
) -> int:
    """Return the teacher's action; in silence the agent's own."""
    return e.label if e.label >= 0 else action


@kernel
def learn(m: Memory, p: QLearningParameters, t: Transition, e: Evidence) -> Learned:
    """Move Q(s, a) by the TD error of r + h; h = 2 q(a) - 1, which is 1 for a command obeyed (Eq. 4)."""
    return one_step(m, p.alpha, p.gamma, t, 2.0 * e.belief[t.action] - 1.0 if e.given else 0.0)


GUIDE = Method(
    name="guide",
    summary="the teacher's action is taken, and rewarded: SfID without the agent's say",
    source="the control condition of Shaping from Interactive Demonstrations (ours)",
    parameters=QLearningParameters,
    learn=learn,
    choose=choose_explored,
    settle=settle,
    asks_before=AnswerKind.LABEL,
)
