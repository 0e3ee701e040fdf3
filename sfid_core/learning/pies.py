"""`pies`: policy invariant explicit shaping (Behboudian et al. 2020)."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import most_blended
from sfid_core.learning.kernels import Draws, Evidence, Learned, Memory, Transition, one_step
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ALPHA, GAMMA, RATE, Range
from sfid_core.teaching.answers import AnswerKind

XI, CELL, ADVICE = range(3)
"""Scalars: the weight of the advice; the cell of Phi of the step before, plus 1; -h of that step."""


class PiesParameters(NamedTuple):
    """Parameters of PIES."""

    alpha: Annotated[float, ALPHA] = 0.1
    """Step size of Q."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of Q."""
    beta: Annotated[float, Range(0, 1, above=True, source="the authors' 20 x 20 grid")] = 0.5
    """Step size of the advice Phi."""
    gamma_advice: Annotated[float, RATE] = 0.0
    """Discount factor of the advice; the authors use Q's. 0 is ours: advice then is about one step, and no
    circuit of praise can grow in it."""
    episodes: Annotated[float, Range(1, 1e6, unit="episodes", source="the authors' 20 x 20 grid")] = 100.0
    """Episodes in which the weight of the advice falls from 1 to 0."""


@kernel
def choose(m: Memory, p: PiesParameters, draws: Draws, state: int, decision: int) -> int:  # noqa: ARG001
    """Return an action with the largest Q - xi * Phi, ties at random."""
    return most_blended(m, draws, state, decision, 0, 1, -m.scalars[XI])


@kernel
def prefer(m: Memory, p: PiesParameters, state: int, action: int) -> float:  # noqa: ARG001 - the interface
    """Return Q - xi * Phi."""
    at = state * m.width + action
    return m.values[at] - m.scalars[XI] * m.values[at + m.actions]


@kernel
def begin(m: Memory, p: PiesParameters, episode: int) -> None:
    """Set xi = max(0, 1 - episode / episodes)."""
    m.scalars[XI] = max(0.0, 1.0 - episode / p.episodes)
    m.scalars[CELL] = 0.0


@kernel
def advise(m: Memory, p: PiesParameters, cell: int, advice: float, ahead: float) -> None:
    """Move Phi of a cell towards the advice and what is ahead of it."""
    m.values[cell] += p.beta * (advice + p.gamma_advice * ahead - m.values[cell])


@kernel
def learn(m: Memory, p: PiesParameters, t: Transition, e: Evidence) -> Learned:
    """Move Q by r alone (Eq. 2), and Phi(s, a) by beta * (-h + gamma_advice * Phi(s', a') - Phi(s, a)).

    a' is known with the next step: the update waits for it, unless nothing ahead counts. A step cut off at
    the cap never learns its a' and is left out.
    """
    cell = t.state * m.width + m.actions + t.action
    advice = -e.reward if e.given else 0.0
    if p.gamma_advice == 0.0:
        advise(m, p, cell, advice, 0.0)
    else:
        if m.scalars[CELL] > 0.0:
            advise(m, p, int(m.scalars[CELL]) - 1, m.scalars[ADVICE], m.values[cell])
        m.scalars[CELL] = cell + 1.0
        m.scalars[ADVICE] = advice
        if t.terminal:
            advise(m, p, cell, advice, 0.0)
    moved = one_step(m, p.alpha, p.gamma, t, 0.0)
    return Learned(moved.environment, moved.shaped, -advice)


PIES = Method(
    name="pies",
    summary="advice learnt beside Q as a potential, weighed less each episode: harmless in the limit",
    source="Behboudian et al. 2020, after the authors' code",
    parameters=PiesParameters,
    learn=learn,
    choose=choose,
    prefer=prefer,
    begin=begin,
    asks_after=AnswerKind.REWARD,
    blocks=2,
    scalars=3,
)
