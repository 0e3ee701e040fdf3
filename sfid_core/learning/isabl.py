"""`isabl`: SABL that infers the teacher's strategy, what they mean by silence (Loftin et al. 2014, 2016).

The strategy (mu+, mu-) has a uniform prior on a grid. Expectation maximisation over the policy lambda, the
most likely action of each state: counts of answers under lambda give the weights of the strategies, these
give what silence is worth, and that gives the next lambda. Everything but the counts of silence under lambda
is independent of lambda, so one number, the worth of silence, carries an iteration.
"""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import explored, most_in_block, softmax_at
from sfid_core.learning.elementary import exp, log
from sfid_core.learning.kernels import Draws, Evidence, Learned, Memory, Transition
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import GAMMA, Choice, Range
from sfid_core.learning.sabl import ERROR
from sfid_core.teaching.answers import AnswerKind

GRID = 5
"""Points of mu+ and of mu-: 0, 0.2, .. 0.8, as in the study; the first is a tenth of a step, because a
strategy that is never silent cannot explain a single silence."""
STEP = 0.2
PRAISED, BLAMED, SILENT, SILENT_RIGHT, WORTH, ANSWER_WORTH, TABLES = range(7)
"""Scalars: steps praised, blamed, silent, and silent on the action of lambda; what silence and what praise
add to a score; then tables over the grid: ln(1 - mu), ln p(0 | right), ln p(0 | wrong)."""
RIGHT = TABLES + GRID
WRONG = RIGHT + GRID * GRID
ACTED = 3
"""Block of the scores that are acted on where the policy is held for an episode."""
EPISODE = 1
ITERATIONS = 100
"""Most iterations after one step; lambda is fixed long before."""


class ISablParameters(NamedTuple):
    """Parameters of I-SABL."""

    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of the measures; I-SABL itself learns no values."""
    error: Annotated[float, ERROR] = 0.2
    """epsilon: the probability that the teacher judges an action wrongly; the true one, or more."""
    explore: Annotated[float, Range(0, 1, source="Loftin et al. 2016: the error rate")] = 0.2
    """Probability of a random action."""
    update: Annotated[int, Choice(("step", "episode"))] = 0
    """When the agent acts on what it learnt: at once, or from the next episode on, its policy held meanwhile.
    Held, it stays in a circle until the episode ends, so a teacher who errs costs it many more steps."""


@kernel
def begin(m: Memory, p: ISablParameters, episode: int) -> None:
    """Fill the tables over the grid before the first episode; hold the policy for this one."""
    if p.update == EPISODE:
        hold(m)
    if episode > 0:
        return
    m.scalars[ANSWER_WORTH] = log((1.0 - p.error) / p.error)
    for i in range(GRID):
        praise_silence = STEP * i if i > 0 else STEP * 0.1
        m.scalars[TABLES + i] = log(1.0 - praise_silence)
        for j in range(GRID):
            blame_silence = STEP * j if j > 0 else STEP * 0.1
            right = (1.0 - p.error) * praise_silence + p.error * blame_silence
            wrong = p.error * praise_silence + (1.0 - p.error) * blame_silence
            m.scalars[RIGHT + i * GRID + j] = log(right)
            m.scalars[WRONG + i * GRID + j] = log(wrong)


@kernel
def hold(m: Memory) -> None:
    """Copy the scores of every state to the block that is acted on."""
    for row in range(0, len(m.values), m.width):
        if m.values[row + m.width - 1] > 0.0:
            for at in range(row, row + m.actions):
                m.values[at + ACTED * m.actions] = m.values[at]


@kernel
def choose(m: Memory, p: ISablParameters, draws: Draws, state: int, decision: int) -> int:
    """Return the most likely action, ties at random; with probability `explore` any action."""
    block = ACTED if p.update == EPISODE else 0
    return explored(m, p.explore, draws, decision, most_in_block(m, draws, state, decision, block))


@kernel
def learn(m: Memory, p: ISablParameters, t: Transition, e: Evidence) -> Learned:  # noqa: ARG001 - tables are kept
    """Count the answer or the silence, and find lambda anew.

    score(s, a) = (n+ - n-)(s, a) ln((1 - eps) / eps) + z(s, a) sum_mu w(mu) ln(p(0 | right) / p(0 | wrong)).
    Both errors of the result are 1 (praise) or 0 (blame) less the probability, under the scores before, that
    the action is right; 0 in silence.
    """
    row = t.state * m.width
    error = 0.0
    right_before = silent_right(m, row)
    if e.given:
        praised = e.reward > 0.0
        error = (1.0 if praised else 0.0) - softmax_at(m, t.state, 0, t.action)
        m.scalars[PRAISED if praised else BLAMED] += 1.0
        m.values[row + m.actions + t.action] += 1.0 if praised else -1.0
    else:
        m.scalars[SILENT] += 1.0
        m.values[row + 2 * m.actions + t.action] += 1.0
    m.values[row + m.width - 1] += 1.0
    score_row(m, row)
    m.scalars[SILENT_RIGHT] += silent_right(m, row) - right_before
    if m.scalars[SILENT] > 0.0:
        maximise(m)
    return Learned(error, error, e.reward)


@kernel
def score_row(m: Memory, row: int) -> None:
    """Compute the scores of one state, its first block, from its counts."""
    for at in range(row, row + m.actions):
        answers, silence = m.values[at + m.actions], m.values[at + 2 * m.actions]
        m.values[at] = answers * m.scalars[ANSWER_WORTH] + silence * m.scalars[WORTH]


@kernel
def silent_right(m: Memory, row: int) -> float:
    """Return the silent steps of a state on its most likely action, the first of several."""
    largest = row
    for at in range(row + 1, row + m.actions):
        if m.values[at] > m.values[largest]:
            largest = at
    return m.values[largest + 2 * m.actions]


@kernel
def maximise(m: Memory) -> None:
    """Iterate: the worth of silence under lambda, then lambda under that worth, until it stays.

    Only states with silent steps depend on the worth. Sums are of whole numbers, so no order changes them.
    """
    for _ in range(ITERATIONS):
        worth = worth_of_silence(m)
        if worth == m.scalars[WORTH]:
            return
        m.scalars[WORTH] = worth
        right = 0.0
        for row in range(0, len(m.values), m.width):
            if m.values[row + m.width - 1] > 0.0:
                score_row(m, row)
                right += silent_right(m, row)
        if right == m.scalars[SILENT_RIGHT]:
            return
        m.scalars[SILENT_RIGHT] = right


@kernel
def worth_of_silence(m: Memory) -> float:
    """Return the mean of ln(p(0 | right) / p(0 | wrong)) over the strategies, weighed by their likelihood.

    w(mu) ~ (1 - mu+)^n+ (1 - mu-)^n- p(0 | right)^z_right p(0 | wrong)^z_wrong, in log space.
    """
    largest = log_weight(m, 0)
    for point in range(1, GRID * GRID):
        largest = max(largest, log_weight(m, point))
    total = worth = 0.0
    for point in range(GRID * GRID):
        weight = exp(log_weight(m, point) - largest)
        total += weight
        worth += weight * (m.scalars[RIGHT + point] - m.scalars[WRONG + point])
    return worth / total


@kernel
def log_weight(m: Memory, point: int) -> float:
    """Return the log-likelihood of one strategy of the grid."""
    right = m.scalars[SILENT_RIGHT]
    return (
        m.scalars[PRAISED] * m.scalars[TABLES + point // GRID]
        + m.scalars[BLAMED] * m.scalars[TABLES + point % GRID]
        + right * m.scalars[RIGHT + point]
        + (m.scalars[SILENT] - right) * m.scalars[WRONG + point]
    )


ISABL = Method(
    name="isabl",
    summary="SABL that infers what the teacher's silence means",
    source="Loftin et al. 2014, 2016, after the authors' code",
    parameters=ISablParameters,
    learn=learn,
    choose=choose,
    begin=begin,
    asks_after=AnswerKind.REWARD,
    blocks=4,
    scalars=WRONG + GRID * GRID,
)
