"""`sabl`: strategy-aware Bayesian learning with a known strategy (Loftin et al. 2014, 2016)."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.choices import choose_explored, softmax_at
from sfid_core.learning.elementary import log
from sfid_core.learning.kernels import Evidence, Learned, Memory, Transition
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import GAMMA, RATE, Range
from sfid_core.teaching.answers import AnswerKind

ERROR = Range(1e-9, 0.5, below=True, source="Loftin et al. 2016")
"""Far below it the weight of one answer, ln((1 - eps) / eps), is no finite number."""
SILENT = Range(0, 1, above=True, below=True, source="balanced; the value is ours")
PRAISE, BLAME, NOTHING = range(3)
"""Scalars: ln p(f | right) - ln p(f | wrong) of each answer f."""


class SablParameters(NamedTuple):
    """Parameters of SABL."""

    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of the measures; SABL itself learns no values."""
    error: Annotated[float, ERROR] = 0.2
    """epsilon: the probability that the teacher judges an action wrongly."""
    praise_silence: Annotated[float, SILENT] = 0.1
    """mu+: the probability of silence about an action judged right."""
    blame_silence: Annotated[float, SILENT] = 0.1
    """mu-: the probability of silence about an action judged wrong."""
    explore: Annotated[float, RATE] = 0.0
    """Probability of a random action. Loftin's agents take `error` here; 0 is ours."""


@kernel
def begin(m: Memory, p: SablParameters, episode: int) -> None:  # noqa: ARG001 - the interface
    """Keep what each answer weighs.

    p(+|right) = (1 - eps)(1 - mu+)       p(+|wrong) = eps (1 - mu+)
    p(-|right) = eps (1 - mu-)            p(-|wrong) = (1 - eps)(1 - mu-)
    p(0|right) = (1 - eps) mu+ + eps mu-  p(0|wrong) = eps mu+ + (1 - eps) mu-
    """
    m.scalars[PRAISE] = log((1.0 - p.error) / p.error)
    m.scalars[BLAME] = -m.scalars[PRAISE]
    right = (1.0 - p.error) * p.praise_silence + p.error * p.blame_silence
    wrong = p.error * p.praise_silence + (1.0 - p.error) * p.blame_silence
    m.scalars[NOTHING] = log(right / wrong)


@kernel
def learn(m: Memory, p: SablParameters, t: Transition, e: Evidence) -> Learned:  # noqa: ARG001 - weights are kept
    """Add ln p(f | right) - ln p(f | wrong) to the log-likelihood that the action is the right one.

    The source adds ln p(f | right) there and ln p(f | wrong) to every other action; taking the latter from
    the whole row leaves all differences as they are. Both errors of the result are those of the posterior
    before the update: 1 (praise) or 0 (blame) less the probability that the action is right; 0 in silence.
    """
    error = 0.0
    weight = m.scalars[NOTHING]
    if e.given:
        praised = e.reward > 0.0
        error = (1.0 if praised else 0.0) - softmax_at(m, t.state, 0, t.action)
        weight = m.scalars[PRAISE] if praised else m.scalars[BLAME]
    m.values[t.state * m.width + t.action] += weight
    m.values[(t.state + 1) * m.width - 1] += 1.0
    return Learned(error, error, e.reward)


SABL = Method(
    name="sabl",
    summary="the most likely action given praise, blame and silence of a teacher whose strategy is known",
    source="Loftin et al. 2014, 2016, after the authors' code",
    parameters=SablParameters,
    learn=learn,
    choose=choose_explored,
    begin=begin,
    asks_after=AnswerKind.REWARD,
    scalars=3,
)
