"""`dpba`: dynamic potential-based advice (Harutyunyan et al. 2015), a baseline to be compared with `pies`."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import explored, most_blended
from sfid_core.learning.kernels import Draws, Evidence, Learned, Memory, Transition, best
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import GAMMA, RATE, Choice, Range
from sfid_core.teaching.answers import AnswerKind

CELL, REWARD, ADVICE = range(3)
"""Scalars: the cell of Q of the step before, plus 1, 0 without one; its reward; its -h."""
CORRECTED = 0


class DpbaParameters(NamedTuple):
    """Parameters of dynamic potential-based advice."""

    alpha: Annotated[float, Range(0, 1, above=True, source="Behboudian et al. 2020, 20 x 20 grid")] = 0.1
    """Step size of Q."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor, of the potential too: another one would change which policy is best."""
    beta: Annotated[float, Range(0, 1, above=True, source="Behboudian et al. 2020, 20 x 20 grid")] = 0.01
    """Step size of the potential Phi."""
    acts: Annotated[int, Choice(("corrected", "shaped"))] = 0
    """On what the agent acts: Q + Phi, which takes back what shaping left in Q (Behboudian et al. 2020), or
    Q alone."""
    explore: Annotated[float, RATE] = 0.1
    """epsilon: probability of a random action; the source's experiments have 0.1."""


@kernel
def choose(m: Memory, p: DpbaParameters, draws: Draws, state: int, decision: int) -> int:
    """Return an action with the largest Q + Phi, or Q, ties at random; with `explore` any action."""
    weight = 1.0 if p.acts == CORRECTED else 0.0
    chosen = most_blended(m, draws, state, decision, 0, 1, weight)
    return explored(m, p.explore, draws, decision, chosen)


@kernel
def prefer(m: Memory, p: DpbaParameters, state: int, action: int) -> float:
    """Return Q + Phi, or Q."""
    at = state * m.width + action
    return m.values[at] + (m.values[at + m.actions] if p.acts == CORRECTED else 0.0)


@kernel
def begin(m: Memory, p: DpbaParameters, episode: int) -> None:  # noqa: ARG001 - the interface
    """Forget the step before: it was cut off, and what would have come next is not known."""
    m.scalars[CELL] = 0.0


@kernel
def sarsa(m: Memory, p: DpbaParameters, value: float, potential: float) -> float:
    """Move Q and Phi of the step before; return the error of Q. `value` and `potential` are of what followed.

    F = gamma Phi(s', a') - Phi(s, a); Q by r + F + gamma Q(s', a') - Q(s, a); Phi by -h + F.
    """
    cell = int(m.scalars[CELL]) - 1
    shaping = p.gamma * potential - m.values[cell + m.actions]
    error = m.scalars[REWARD] + shaping + p.gamma * value - m.values[cell]
    m.values[cell] += p.alpha * error
    m.values[cell + m.actions] += p.beta * (m.scalars[ADVICE] + shaping)
    return error


@kernel
def learn(m: Memory, p: DpbaParameters, t: Transition, e: Evidence) -> Learned:
    """Learn from the step before, whose a' is this step's action, and from this one too where it ends.

    The errors of the result are r + gamma max Q(s', .) - Q(s, a) of this step, and that by which Q moved.
    """
    cell = t.state * m.width + t.action
    ahead = 0.0 if t.terminal else best(m, t.next_state)
    environment = t.reward + p.gamma * ahead - m.values[cell]
    shaped = 0.0
    if m.scalars[CELL] > 0.0:
        shaped = sarsa(m, p, m.values[cell], m.values[cell + m.actions])
    m.scalars[CELL] = cell + 1.0
    m.scalars[REWARD] = t.reward
    m.scalars[ADVICE] = -e.reward if e.given else 0.0
    if t.terminal:
        shaped = sarsa(m, p, 0.0, 0.0)
        m.scalars[CELL] = 0.0
    m.values[(t.state + 1) * m.width - 1] += 1.0
    return Learned(environment, shaped, e.reward if e.given else 0.0)


DPBA = Method(
    name="dpba",
    summary="advice learnt as a potential that shapes a Sarsa learner: slow, and easily led astray; see pies",
    source="Harutyunyan et al. 2015, after the code of Behboudian et al. 2020",
    parameters=DpbaParameters,
    learn=learn,
    choose=choose,
    prefer=prefer,
    begin=begin,
    asks_after=AnswerKind.REWARD,
    blocks=2,
    scalars=3,
)
