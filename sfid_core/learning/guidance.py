"""`guidance`: reward, guidance and undo (Thomaz & Breazeal 2006; Suay & Chernova 2011)."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import best_among
from sfid_core.learning.kernels import Draws, Evidence, Learned, Memory, Transition, one_step
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ALPHA, GAMMA, Choice
from sfid_core.teaching.answers import AnswerKind


class GuidanceParameters(NamedTuple):
    """Parameters of reward with guidance; step size and discount are those of the founding paper.

    Thomaz & Breazeal used alpha 0.3 and gamma 0.75 (from memory, unverified).
    """

    alpha: Annotated[float, ALPHA] = 0.1
    """Step size."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor."""
    undo: Annotated[int, Choice(("blamed", "asked", "never"))] = 0
    """When the environment takes a step back: after blame or when a teacher says so, when one says so, never.
    A push has no reversing action, so the world is put back; nothing is learnt from that."""


@kernel
def settle(
    m: Memory,
    p: GuidanceParameters,  # noqa: ARG001 - the interface
    draws: Draws,
    state: int,
    action: int,
    evidence: Evidence,
    decision: int,
) -> int:
    """Return argmax of Q over the actions that the teacher points at; without guidance the agent's own."""
    if evidence.guidance == 0:
        return action
    return best_among(m, draws.explore, state, evidence.guidance, decision)


@kernel
def learn(m: Memory, p: GuidanceParameters, t: Transition, e: Evidence) -> Learned:
    """Move Q(s, a) by the TD error of r + h; guidance chooses and does not reward."""
    return one_step(m, p.alpha, p.gamma, t, e.reward)


@kernel
def undo(p: GuidanceParameters, evidence: Evidence) -> int:
    """Return 1 where the step is to be taken back."""
    if p.undo == 2:
        return 0
    if evidence.undo == 1:
        return 1
    return 1 if p.undo == 0 and evidence.reward < 0.0 else 0


GUIDANCE = Method(
    name="guidance",
    summary="reward, with guidance to actions worth considering before it and undo after it",
    source="Thomaz & Breazeal 2006; Suay & Chernova 2011",
    parameters=GuidanceParameters,
    learn=learn,
    settle=settle,
    undo=undo,
    may_undo=True,
    asks_before=AnswerKind.GUIDANCE,
    asks_after=AnswerKind.REWARD,
)
