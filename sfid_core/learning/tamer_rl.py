"""`tamer-rl`: TAMER's model beside reinforcement learning (Knox & Stone 2010, 2012)."""

from typing import Annotated, NamedTuple

from sfid_core.chance import unit
from sfid_core.compiled import kernel
from sfid_core.learning.choices import choose_explored, explored, most_in_block, one_of
from sfid_core.learning.elementary import exp, log
from sfid_core.learning.human_model import (
    CREDIT,
    MODEL_SCALARS,
    SILENCE,
    TRAIL_COLUMNS,
    WINDOW_FROM,
    WINDOW_SPAN,
    HumanModel,
    forget_steps,
    hear,
)
from sfid_core.learning.kernels import (
    Draws,
    Evidence,
    Learned,
    Memory,
    Transition,
    best,
    one_step,
)
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import ALPHA, GAMMA, RATE, Choice, Range
from sfid_core.teaching.answers import AnswerKind

WEIGHT, STEP = MODEL_SCALARS, MODEL_SCALARS + 1
"""Scalars: B, the weight of the teacher's model; the steps learnt so far, by which eligibility fades."""
ELIGIBLE, SINCE = 2, 3
"""Blocks: the eligibility of each action in each state, and the step at which it was that."""
ELIGIBILITY = 1
APART = 1 << 40
"""How far from the draws of exploration those of control sharing are read."""
IN_CONTROL = 1
HALF = 0.5
ACTION_BIASING, CONTROL_SHARING, Q_AUGMENTATION, REWARD_SHAPING = range(4)


class TamerRLParameters(NamedTuple):
    """Parameters of TAMER+RL; see `human_model.HumanModel` for the teacher's model."""

    alpha: Annotated[float, ALPHA] = 0.1
    """Step size of Q."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of Q."""
    technique: Annotated[
        int,
        Choice(
            ("action-biasing", "control-sharing", "q-augmentation", "reward-shaping"),
            source="Knox & Stone 2012: action biasing",
        ),
    ] = 0
    """How the teacher's model H enters, with weight B. Acted on is Q + B H and Q learns from the environment
    alone (action-biasing); H instead of Q with probability B (control-sharing); Q + B H, whose error Q learns
    from (q-augmentation); Q, which is paid B H besides (reward-shaping)."""
    weight: Annotated[float, Range(0, 1000)] = 1.0
    """B in the first episode. Knox's code has 10 for tasks with larger returns; 1 is ours."""
    anneal: Annotated[float, Range(0, 1, source="Griffith's code")] = 0.99
    """Factor on B after each episode. Knox's code has 0.97 to 0.98: with Q augmentation B then falls faster
    than Q can follow, and wrong actions come to the top."""
    influence: Annotated[int, Choice(("episodes", "eligibility"), source="Knox & Stone 2012")] = 0
    """What weakens the teacher's model: B falls by `anneal`, or B counts where answers are recent and little
    elsewhere, B(s, a) = B * e(s, a), B itself staying."""
    eligibility_gain: Annotated[float, Range(0, 1, above=True, unit="an answer")] = 0.2
    """c: e(s, a) rises by this with each answer, to 1 at most; 0.2 is ours."""
    eligibility_decay: Annotated[float, Range(0, 1, above=True, source="Knox's code: 0.95 to 0.9998")] = 0.998
    """Factor on every e(s, a) after each step."""
    model_alpha: Annotated[float, Range(0, 1, above=True, source="Knox's loop maze")] = 0.2
    """Step size of H."""
    credit: Annotated[int, CREDIT] = 0
    """Which steps a reward is for."""
    window_from_ms: Annotated[float, WINDOW_FROM] = 200.0
    """Shortest delay of an answer."""
    window_span_ms: Annotated[float, WINDOW_SPAN] = 600.0
    """Longest delay less the shortest."""
    silence: Annotated[int, SILENCE] = 0
    """What a step without an answer teaches H."""
    forget: Annotated[float, RATE] = 0.1
    """Share of H(s, a) that one silent step takes away, with silence `decay`."""
    explore: Annotated[float, RATE] = 0.1
    """epsilon: probability of a random action. Knox's mountain car: 0.00625 * 0.99**episode; 0.1 is ours."""
    alone: Annotated[int, Choice(("shared", "in-control"))] = 0
    """What the policy of control sharing is, the teacher gone: the most probable action of the two that
    share it, or that of whoever is in control more often than not: of Q alone once B is below 1/2."""


@kernel
def model_of(p: TamerRLParameters) -> HumanModel:
    """Return how H, the second block, is learnt."""
    return HumanModel(1, p.model_alpha, p.credit, p.window_from_ms, p.window_span_ms, p.silence, p.forget)


@kernel
def begin(m: Memory, p: TamerRLParameters, episode: int) -> None:
    """Anneal B, and close the credit of the episode before."""
    forget_steps(m, model_of(p))
    annealed = episode > 0 and p.influence != ELIGIBILITY
    m.scalars[WEIGHT] = m.scalars[WEIGHT] * p.anneal if annealed else p.weight


@kernel
def weight_of(m: Memory, p: TamerRLParameters, state: int, action: int) -> float:
    """Return B, or B(s, a) = B * e(s, a)."""
    if p.influence != ELIGIBILITY:
        return m.scalars[WEIGHT]
    return m.scalars[WEIGHT] * eligibility(m, p, state, action)


@kernel
def eligibility(m: Memory, p: TamerRLParameters, state: int, action: int) -> float:
    """Return e(s, a) as it has faded since its latest answer.

    The source has B(s, a) = B * sum(phi_i * min(1, e_i)) / sum(phi_i) over the features of (s, a), which in a
    table are one; e_i grows by c * phi_i for each answer, here about the step that was shown when it came,
    and fades by a factor each step.
    """
    at = state * m.width + action
    eligible = m.values[at + ELIGIBLE * m.actions]
    if eligible <= 0.0:
        return 0.0
    age = m.scalars[STEP] - m.values[at + SINCE * m.actions]
    return eligible * exp(age * log(p.eligibility_decay))


@kernel
def heard(m: Memory, p: TamerRLParameters, state: int, action: int, given: int) -> None:
    """Count a step, and raise the eligibility of an action that was answered."""
    m.scalars[STEP] += 1.0
    if p.influence == ELIGIBILITY and given > 0:
        at = state * m.width + action
        raised = min(1.0, eligibility(m, p, state, action) + p.eligibility_gain)
        m.values[at + ELIGIBLE * m.actions] = raised
        m.values[at + SINCE * m.actions] = m.scalars[STEP]


@kernel
def share_of_model(m: Memory, p: TamerRLParameters, state: int) -> float:
    """Return the probability with which the model has control of a state: the largest B(s, .), 1 at most."""
    most = weight_of(m, p, state, 0)
    for action in range(1, m.actions):
        most = max(most, weight_of(m, p, state, action))
    return min(most, 1.0)


@kernel
def biased(m: Memory, p: TamerRLParameters, state: int, action: int) -> float:
    """Return Q + B(s, a) * H."""
    at = state * m.width + action
    return m.values[at] + weight_of(m, p, state, action) * m.values[at + m.actions]


@kernel
def most_biased(m: Memory, p: TamerRLParameters, draws: Draws, state: int, decision: int) -> int:
    """Return an action with the largest Q + B(s, a) * H, ties at random."""
    largest = biased(m, p, state, 0)
    tied = 1
    for action in range(1, m.actions):
        value = biased(m, p, state, action)
        if value > largest:
            largest = value
            tied = 1 << action
        elif value == largest:
            tied |= 1 << action
    return one_of(tied, draws.ties, decision, m.actions)


@kernel
def choose(m: Memory, p: TamerRLParameters, draws: Draws, state: int, decision: int) -> int:
    """Return the action, ties at random; with probability `explore` any action.

    action biasing, Q augmentation: argmax Q + B * H. control sharing: argmax H with probability min(B, 1),
    else argmax Q. reward shaping: argmax Q.
    """
    if p.technique == REWARD_SHAPING:
        return choose_explored(m, p, draws, state, decision)
    if p.technique == CONTROL_SHARING:
        shared = unit(draws.explore, decision + APART) < share_of_model(m, p, state)
        chosen = most_in_block(m, draws, state, decision, 1 if shared else 0)
    else:
        chosen = most_biased(m, p, draws, state, decision)
    return explored(m, p.explore, draws, decision, chosen)


@kernel
def prefer(m: Memory, p: TamerRLParameters, state: int, action: int) -> float:
    """Return Q + B * H; under reward shaping Q; under control sharing as `alone` says.

    `shared`: the probability of the action, which from B = 1/2 on is first a matter of H. `in-control`: the
    same, but Q below B = 1/2.
    """
    at = state * m.width
    if p.technique == REWARD_SHAPING:
        return m.values[at + action]
    if p.technique == CONTROL_SHARING:
        shared = share_of_model(m, p, state)
        if p.alone == IN_CONTROL and shared < HALF:
            return m.values[at + action]
        return shared * greedy_share_of(m, at + m.actions, action) + (1.0 - shared) * greedy_share_of(
            m, at, action
        )
    return biased(m, p, state, action)


@kernel
def greedy_share_of(m: Memory, at: int, action: int) -> float:
    """Return the probability of an action under the largest of the numbers from `at` on, ties at random."""
    ties = 0
    for other in range(m.actions):
        if m.values[at + other] > m.values[at + action]:
            return 0.0
        if m.values[at + other] == m.values[at + action]:
            ties += 1
    return 1.0 / ties


@kernel
def learn(m: Memory, p: TamerRLParameters, t: Transition, e: Evidence) -> Learned:
    """Learn H from the teacher, then Q from the environment.

    action biasing, control sharing: Q by r alone. reward shaping: by r + B * H(s, a). Q augmentation: by
    r + gamma * max (Q + B * H)(s', .) - (Q + B * H)(s, a).
    """
    hear(m, model_of(p), t, e)
    heard(m, p, t.state, t.action, e.given)
    weight = weight_of(m, p, t.state, t.action)
    predicted = m.values[t.state * m.width + m.actions + t.action]
    if p.technique == REWARD_SHAPING:
        moved = one_step(m, p.alpha, p.gamma, t, weight * predicted)
        return Learned(moved.environment, moved.shaped, e.reward)
    if p.technique == Q_AUGMENTATION:
        return augmented_step(m, p, t, e)
    moved = one_step(m, p.alpha, p.gamma, t, 0.0)
    return Learned(moved.environment, moved.shaped, e.reward)


@kernel
def augmented_step(m: Memory, p: TamerRLParameters, t: Transition, e: Evidence) -> Learned:
    """Move Q(s, a) by the TD error of Q + B * H."""
    at = t.state * m.width + t.action
    ahead = 0.0 if t.terminal else best(m, t.next_state)
    environment = t.reward + p.gamma * ahead - m.values[at]
    largest = 0.0
    if not t.terminal:
        largest = biased(m, p, t.next_state, 0)
        for action in range(1, m.actions):
            largest = max(largest, biased(m, p, t.next_state, action))
    shaped = t.reward + p.gamma * largest - biased(m, p, t.state, t.action)
    m.values[at] += p.alpha * shaped
    m.values[(t.state + 1) * m.width - 1] += 1.0
    return Learned(environment, shaped, e.reward)


TAMER_RL = Method(
    name="tamer-rl",
    summary="TAMER's model steers, or rewards, a Q-learner; its weight is annealed",
    source="Knox & Stone 2010, 2012, after Knox's code",
    parameters=TamerRLParameters,
    learn=learn,
    choose=choose,
    prefer=prefer,
    begin=begin,
    asks_after=AnswerKind.REWARD,
    blocks=4,
    scalars=MODEL_SCALARS + 2,
    trail=TRAIL_COLUMNS,
)
