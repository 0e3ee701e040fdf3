"""`coach`: convergent actor-critic by humans (MacGlashan et al. 2017)."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import softmax_at, softmax_sample
from sfid_core.learning.kernels import Draws, Evidence, Learned, Memory, Transition
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import GAMMA, Range
from sfid_core.teaching.answers import AnswerKind

STATE, ACTION, TRACED = range(3)
"""Columns of the trail: state and action of each step; the states whose trace is not 0, each once."""
TRACES = 0
"""Scalar: number of states whose trace is not 0."""


class CoachParameters(NamedTuple):
    """Parameters of COACH with a tabular softmax policy."""

    alpha: Annotated[float, Range(0, 100, above=True)] = 0.5
    """Step size; the tabular codes have 0.05 with many more steps, 0.5 is ours."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of the measures; COACH itself learns no values."""
    trace: Annotated[float, Range(0, 1, below=True)] = 0.5
    """lambda: how much of the trace is left after a step. 0.95 on the robot (33 ms a step), 0.35 in Deep
    COACH, 0.1 in a tabular grid; 0.5 is ours."""
    delay_steps: Annotated[float, Range(0, 1000, unit="steps")] = 0.0
    """d: feedback is for the step so many steps ago; 6 on the robot, 0 turn by turn."""


@kernel
def choose(m: Memory, p: CoachParameters, draws: Draws, state: int, decision: int) -> int:  # noqa: ARG001
    """Return an action drawn from softmax(theta(s, .))."""
    return softmax_sample(m, draws, state, decision, 0)


@kernel
def begin(m: Memory, p: CoachParameters, episode: int) -> None:  # noqa: ARG001 - the interface
    """Set the traces of the episode before to 0."""
    clear(m)


@kernel
def clear(m: Memory) -> None:
    """Set all traces to 0."""
    for place in range(int(m.scalars[TRACES])):
        at = int(m.trail[place * 3 + TRACED]) * m.width + m.actions
        for action in range(m.actions):
            m.values[at + action] = 0.0
    m.scalars[TRACES] = 0.0


@kernel
def learn(m: Memory, p: CoachParameters, t: Transition, e: Evidence) -> Learned:
    """Trace the step `delay_steps` ago, e <- lambda e + grad ln pi(a | s), and move theta by alpha f e.

    Tabular softmax: the gradient is 1{b = a} - pi(b | s) in row s and 0 elsewhere, taken under the policy
    as it is now. Both errors of the result are f (1 - pi(a | s)): how far the policy was from the action.
    """
    m.trail[t.step * 3 + STATE] = t.state
    m.trail[t.step * 3 + ACTION] = t.action
    error = e.reward * (1.0 - softmax_at(m, t.state, 0, t.action))
    if p.trace > 0.0:
        fade(m, p.trace)
    else:
        clear(m)
    ago = t.step - int(p.delay_steps)
    if ago >= 0:
        trace_step(m, int(m.trail[ago * 3 + STATE]), int(m.trail[ago * 3 + ACTION]))
    if e.given:
        for place in range(int(m.scalars[TRACES])):
            at = int(m.trail[place * 3 + TRACED]) * m.width
            for action in range(m.actions):
                m.values[at + action] += p.alpha * e.reward * m.values[at + m.actions + action]
    m.values[(t.state + 1) * m.width - 1] += 1.0
    return Learned(error, error, e.reward)


@kernel
def fade(m: Memory, factor: float) -> None:
    """Weaken all traces."""
    for place in range(int(m.scalars[TRACES])):
        at = int(m.trail[place * 3 + TRACED]) * m.width + m.actions
        for action in range(m.actions):
            m.values[at + action] *= factor


@kernel
def trace_step(m: Memory, state: int, action: int) -> None:
    """Add the gradient of one step to the trace of its state."""
    count = int(m.scalars[TRACES])
    place = 0
    while place < count and m.trail[place * 3 + TRACED] != state:
        place += 1
    if place == count:
        m.trail[count * 3 + TRACED] = state
        m.scalars[TRACES] = count + 1.0
    at = state * m.width + m.actions
    for other in range(m.actions):
        m.values[at + other] -= softmax_at(m, state, 0, other)
    m.values[at + action] += 1.0


COACH = Method(
    name="coach",
    summary="the teacher's reward is the advantage in a policy gradient with eligibility traces",
    source="MacGlashan et al. 2017",
    parameters=CoachParameters,
    learn=learn,
    choose=choose,
    begin=begin,
    asks_after=AnswerKind.REWARD,
    blocks=2,
    scalars=1,
    trail=3,
)
