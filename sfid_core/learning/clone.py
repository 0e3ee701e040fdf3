"""`clone`: behavioural cloning. The teacher drives; then the agent does what was done most often."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.kernels import Draws, Evidence, Learned, Memory, Transition
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import GAMMA, Range
from sfid_core.teaching.answers import AnswerKind

EPISODE = 0
"""Scalar: the running episode."""


class CloneParameters(NamedTuple):
    """Parameters of behavioural cloning."""

    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of the measures; nothing is bootstrapped."""
    demonstrations: Annotated[float, Range(1, 1e6, unit="episodes")] = 30.0
    """Episodes in which the teacher drives; labels of later ones are not learnt from."""


@kernel
def begin(m: Memory, p: CloneParameters, episode: int) -> None:  # noqa: ARG001 - the interface
    """Note the episode."""
    m.scalars[EPISODE] = episode


@kernel
def settle(
    m: Memory,
    p: CloneParameters,
    draws: Draws,  # noqa: ARG001 - the interface
    state: int,  # noqa: ARG001
    action: int,
    e: Evidence,
    decision: int,  # noqa: ARG001
) -> int:
    """Return the teacher's action while they drive; without a label, and afterwards, the agent's own."""
    return e.label if e.label >= 0 and m.scalars[EPISODE] < p.demonstrations else action


@kernel
def count_labels(m: Memory, t: Transition, e: Evidence, learnt: int) -> Learned:
    """Add the belief in each action to its count, if it is to be learnt; 2 q(a) - 1 is the agreement.

    Both errors of the result are those of the frequency before: belief in the action taken less its share
    of the counts (1 / K in a state without any); 0 in silence.
    """
    if not e.given:
        return Learned(0.0, 0.0, 0.0)
    at = t.state * m.width
    total = 0.0
    for action in range(m.actions):
        total += m.values[at + action]
    share = m.values[at + t.action] / total if total > 0.0 else 1.0 / m.actions
    belief = e.belief[t.action]
    if learnt:
        for action in range(m.actions):
            m.values[at + action] += e.belief[action]
        m.values[at + m.width - 1] += 1.0
    return Learned(belief - share, belief - share, 2.0 * belief - 1.0)


@kernel
def learn(m: Memory, p: CloneParameters, t: Transition, e: Evidence) -> Learned:
    """Count the label, N(s, a_b) += 1, while the teacher drives; the policy is argmax N(s, .)."""
    return count_labels(m, t, e, 1 if m.scalars[EPISODE] < p.demonstrations else 0)


CLONE = Method(
    name="clone",
    summary="behavioural cloning: the teacher drives for some episodes, then the agent imitates",
    source="learning from demonstration; a table's most frequent label",
    parameters=CloneParameters,
    learn=learn,
    settle=settle,
    begin=begin,
    asks_before=AnswerKind.LABEL,
    scalars=1,
)
