"""`advise`: policy shaping (Griffith et al. 2013): answers are evidence about the policy itself."""

from dataclasses import replace
from typing import Annotated, NamedTuple

from sfid_core.chance import unit
from sfid_core.compiled import kernel
from sfid_core.learning.elementary import exp, log
from sfid_core.learning.kernels import Draws, Evidence, Learned, Memory, Transition, one_step
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ALPHA, GAMMA, Choice, Range
from sfid_core.teaching.answers import AnswerKind

LOG_ODDS, AGREED, COMPARED = range(3)
"""Scalars: ln(C / (1 - C)); answers that agreed with what had been said, and those that were compared."""
ONE = 0
ONLINE = 1
LEAD = 2.0
"""Answers by which one side must lead before it is what a new one is compared with (ours)."""
CONSISTENCY_MAX = 0.99
"""Largest estimate: no count of agreements makes a teacher infallible."""


class AdviseParameters(NamedTuple):
    """Parameters of Advise."""

    alpha: Annotated[float, ALPHA] = 0.1
    """Step size of Q."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of Q."""
    consistency: Annotated[float, Range(0.5, 1, below=True, source="Griffith et al. 2013: 0.8, moderate")] = (
        0.8
    )
    """C: the probability that an answer is right."""
    optima: Annotated[int, Choice(("one", "several"))] = 0
    """Whether one action of a state is optimal, or any number of them."""
    estimate: Annotated[int, Choice(("known", "online"))] = 0
    """Where C comes from: `consistency`, or that at first and then the share of answers that agree with a
    consensus: a Beta estimate within 0.5 to 0.99 (ours; the source has C known)."""
    prior_answers: Annotated[float, Range(0, 1e6, above=True, unit="answers")] = 10.0
    """How many compared answers `consistency` is worth, with the estimate `online` (ours)."""
    temperature: Annotated[float, Range(1e-6, 1000, unit="reward")] = 1.0
    """Temperature of the Boltzmann policy of Q. The source has Bayesian Q-learning in its place."""


@kernel
def begin(m: Memory, p: AdviseParameters, episode: int) -> None:  # noqa: ARG001 - the interface
    """Keep the weight of one answer."""
    weigh(m, p)


@kernel
def weigh(m: Memory, p: AdviseParameters) -> None:
    """Keep ln(C / (1 - C)), C being known or (prior * consistency + agreed) / (prior + compared)."""
    consistency = p.consistency
    if p.estimate == ONLINE:
        agreed = p.prior_answers * p.consistency + m.scalars[AGREED]
        consistency = min(max(agreed / (p.prior_answers + m.scalars[COMPARED]), 0.5), CONSISTENCY_MAX)
    m.scalars[LOG_ODDS] = log(consistency / (1.0 - consistency))


@kernel
def compare(m: Memory, p: AdviseParameters, t: Transition, e: Evidence) -> None:
    """Compare an answer with what was said of its state before, where one side leads by `LEAD` answers.

    A reward agrees where D of its action has its sign, a label where its action is ahead of all others.
    """
    at = t.state * m.width + m.actions
    if e.label >= 0:
        ahead = 0
        second = -1e300
        for action in range(1, m.actions):
            if m.values[at + action] > m.values[at + ahead]:
                ahead = action
        for action in range(m.actions):
            if action != ahead:
                second = max(second, m.values[at + action])
        if m.values[at + ahead] - second < LEAD:
            return
        agrees = e.label == ahead
    else:
        said = m.values[at + t.action]
        if e.reward == 0.0 or abs(said) < LEAD:
            return
        agrees = (said > 0.0) == (e.reward > 0.0)
    m.scalars[COMPARED] += 1.0
    m.scalars[AGREED] += 1.0 if agrees else 0.0
    weigh(m, p)


@kernel
def preference(m: Memory, p: AdviseParameters, state: int, action: int) -> float:
    """Return the logarithm, but for a constant of the state, of the probability of an action.

    pi ~ pi_Q * pi_F, pi_Q = softmax(Q / temperature), D the answers for an action less those against it:
    one optimum: pi_F ~ C**D_a * (1 - C)**(sum of the others' D), which is softmax(D * ln(C / (1 - C)));
    several: pi_F ~ C**D / (C**D + (1 - C)**D).
    """
    at = state * m.width + action
    evidence = m.values[at + m.actions] * m.scalars[LOG_ODDS]
    if p.optima != ONE:
        # ln(1 / (1 + e**-x)), whichever way e** stays small
        against = log(1.0 + exp(-abs(evidence)))
        evidence = -against if evidence >= 0.0 else evidence - against
    return m.values[at] / p.temperature + evidence


@kernel
def choose(m: Memory, p: AdviseParameters, draws: Draws, state: int, decision: int) -> int:
    """Return an action drawn from pi_Q * pi_F."""
    largest = preference(m, p, state, 0)
    for action in range(1, m.actions):
        largest = max(largest, preference(m, p, state, action))
    total = 0.0
    for action in range(m.actions):
        total += exp(preference(m, p, state, action) - largest)
    rest = unit(draws.explore, decision) * total
    for action in range(m.actions - 1):
        rest -= exp(preference(m, p, state, action) - largest)
        if rest < 0.0:
            return action
    return m.actions - 1


@kernel
def learn(m: Memory, p: AdviseParameters, t: Transition, e: Evidence) -> Learned:
    """Count the answer in D, and move Q by r alone (Eq. 2).

    A reward counts +1 or -1 for the action that was seen; a label counts as much as it is believed for each
    action, whichever was taken.
    """
    if p.estimate == ONLINE:
        compare(m, p, t, e)
    h = e.reward
    at = t.state * m.width + m.actions
    if e.label >= 0:
        for action in range(m.actions):
            m.values[at + action] += e.belief[action]
        h = 2.0 * e.belief[t.action] - 1.0
    elif e.reward > 0.0:
        m.values[at + t.action] += 1.0
    elif e.reward < 0.0:
        m.values[at + t.action] -= 1.0
    moved = one_step(m, p.alpha, p.gamma, t, 0.0)
    return Learned(moved.environment, moved.shaped, h)


ADVISE = Method(
    name="advise",
    summary="policy shaping: the teacher's answers multiply the policy instead of adding to the reward",
    source="Griffith et al. 2013",
    parameters=AdviseParameters,
    learn=learn,
    choose=choose,
    prefer=preference,
    begin=begin,
    asks_after=AnswerKind.REWARD,
    blocks=2,
    scalars=3,
)
ADVISE_LABELS = replace(
    ADVISE,
    name="advise-labels",
    summary="policy shaping from the actions that the teacher would take",
    asks_before=AnswerKind.LABEL,
    asks_after=None,
)
