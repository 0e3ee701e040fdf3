"""`marks`: a teacher marks where the agent went wrong, and says what it should have done."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.kernels import Evidence, Learned, Memory, Transition, one_step
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ALPHA, GAMMA, Range
from sfid_core.teaching.answers import AnswerKind

STATE, ACTION = 0, 1
"""Columns of the trail: where each step of the episode was taken, and which action it was."""
COLUMNS = 2


class MarksParameters(NamedTuple):
    """Parameters of learning from mistake marks; step size and discount are those of the founding paper."""

    alpha: Annotated[float, ALPHA] = 0.1
    """Step size."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor."""
    influence: Annotated[float, Range(0, 1e6)] = 20.0
    """What marks may come to, in sum, for one state and action, either way: careless or hostile workers are
    bounded (ours)."""


@kernel
def nudge(m: Memory, p: MarksParameters, state: int, action: int, h: float) -> float:
    """Move Q(s, a) by alpha h as far as the influence of marks is not used up; return the h applied."""
    at = state * m.width
    used = m.values[at + m.actions + action]
    bounded = min(max(used + h, -p.influence), p.influence) - used
    m.values[at + m.actions + action] = used + bounded
    m.values[at + action] += p.alpha * bounded
    m.values[at + m.width - 1] += 1.0
    return bounded


@kernel
def learn(m: Memory, p: MarksParameters, t: Transition, e: Evidence) -> Learned:
    """Learn the step by Eq. 2; share -1 among the marked steps, and give +1 to what should have been done.

    A mark of n steps costs each of them 1 / n; what should have been done is credited in the state where the
    mark begins. Steps of other episodes, or not taken yet, cannot be marked.
    Source: De la Cruz, Peng, Lasecki & Taylor 2015 (that workers mark stretches and corrections); the form
    is ours.
    """
    m.trail[t.step * COLUMNS + STATE] = t.state
    m.trail[t.step * COLUMNS + ACTION] = t.action
    learned = one_step(m, p.alpha, p.gamma, t, 0.0)
    last = min(e.last, t.step)
    if e.first < 0 or last < e.first:
        return learned
    here = 0.0
    share = -1.0 / (last - e.first + 1)
    for step in range(e.first, last + 1):
        state = int(m.trail[step * COLUMNS + STATE])
        given = nudge(m, p, state, int(m.trail[step * COLUMNS + ACTION]), share)
        if step == t.step:
            here = given
    if e.label >= 0:
        nudge(m, p, int(m.trail[e.first * COLUMNS + STATE]), e.label, 1.0)
    return Learned(learned.environment, learned.environment + here, here)


MARKS = Method(
    name="marks",
    summary="mistake marks: where the agent went wrong, and what it should have done",
    source="De la Cruz et al. 2015; update ours",
    parameters=MarksParameters,
    learn=learn,
    asks_after=AnswerKind.MISTAKE,
    blocks=2,
    trail=COLUMNS,
)
