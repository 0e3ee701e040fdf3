"""`dagger`: data aggregation (Ross, Gordon & Bagnell 2011): the teacher labels whatever state is met."""

from typing import Annotated, NamedTuple

from sfid_core.chance import unit
from sfid_core.compiled import kernel
from sfid_core.learning.clone import count_labels
from sfid_core.learning.kernels import Draws, Evidence, Learned, Memory, Transition
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import GAMMA, Choice, Range
from sfid_core.teaching.answers import AnswerKind

BETA = 0
"""Scalar: the probability that the teacher drives a step."""
LINEAR = 0


class DaggerParameters(NamedTuple):
    """Parameters of DAgger; an episode is a round."""

    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of the measures; nothing is bootstrapped."""
    schedule: Annotated[int, Choice(("linear", "power"))] = 0
    """How beta falls: from 1 to 0 over `rounds`, or by the factor `base` each round."""
    rounds: Annotated[float, Range(1, 1e6, unit="episodes", source="the imitation library")] = 15.0
    """Rounds until beta is 0, with the schedule `linear`."""
    base: Annotated[float, Range(0, 1)] = 0.5
    """beta of the next round over beta of this one, with the schedule `power`; 0 leaves the first round alone
    to the teacher."""


@kernel
def begin(m: Memory, p: DaggerParameters, episode: int) -> None:
    """Set beta."""
    if p.schedule == LINEAR:
        m.scalars[BETA] = max(0.0, 1.0 - episode / p.rounds)
    else:
        m.scalars[BETA] = 1.0 if episode == 0 else m.scalars[BETA] * p.base


@kernel
def settle(
    m: Memory,
    p: DaggerParameters,  # noqa: ARG001 - the interface
    draws: Draws,
    state: int,  # noqa: ARG001
    action: int,
    e: Evidence,
    decision: int,
) -> int:
    """Return the teacher's action with probability beta, else the agent's own."""
    return e.label if e.label >= 0 and unit(draws.explore, decision) < m.scalars[BETA] else action


@kernel
def learn(m: Memory, p: DaggerParameters, t: Transition, e: Evidence) -> Learned:  # noqa: ARG001 - always learnt
    """Count the label, N(s, a_b) += 1, whoever drives; the policy is argmax N(s, .)."""
    return count_labels(m, t, e, 1)


DAGGER = Method(
    name="dagger",
    summary="the teacher labels every state met and drives ever less; the agent does what most labels say",
    source="Ross, Gordon & Bagnell 2011; defaults of the imitation library",
    parameters=DaggerParameters,
    learn=learn,
    settle=settle,
    begin=begin,
    asks_before=AnswerKind.LABEL,
    scalars=1,
)
