"""`tamer`: learn what the teacher will say, and act on it (Knox & Stone 2009)."""

from typing import Annotated, NamedTuple

from sfid_core.compiled import kernel
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
from sfid_core.learning.kernels import Evidence, Learned, Memory, Transition
from sfid_core.learning.method import Method
from sfid_core.learning.parameters import GAMMA, RATE, Range
from sfid_core.teaching.answers import AnswerKind


class TamerParameters(NamedTuple):
    """Parameters of TAMER; see `human_model.HumanModel`."""

    alpha: Annotated[float, Range(0, 1, above=True, source="Knox's loop maze")] = 0.2
    """Step size of H."""
    gamma: Annotated[float, GAMMA] = 0.9
    """Discount factor of the measures; TAMER itself looks one step ahead."""
    credit: Annotated[int, CREDIT] = 0
    """Which steps a reward is for."""
    window_from_ms: Annotated[float, WINDOW_FROM] = 200.0
    """Shortest delay of an answer."""
    window_span_ms: Annotated[float, WINDOW_SPAN] = 600.0
    """Longest delay less the shortest."""
    silence: Annotated[int, SILENCE] = 0
    """What a step without an answer teaches."""
    forget: Annotated[float, RATE] = 0.1
    """Share of H(s, a) that one silent step takes away, with silence `decay`."""


@kernel
def model_of(p: TamerParameters) -> HumanModel:
    """Return how H is learnt."""
    return HumanModel(0, p.alpha, p.credit, p.window_from_ms, p.window_span_ms, p.silence, p.forget)


@kernel
def begin(m: Memory, p: TamerParameters, episode: int) -> None:  # noqa: ARG001 - the interface
    """Close the credit of the episode before."""
    forget_steps(m, model_of(p))


@kernel
def learn(m: Memory, p: TamerParameters, t: Transition, e: Evidence) -> Learned:
    """Move H(s, a) by alpha * (h - H(s, a)); both errors of the result are h - H(s, a), 0 in silence."""
    error = hear(m, model_of(p), t, e)
    return Learned(error, error, e.reward)


TAMER = Method(
    name="tamer",
    summary="a model of the teacher's reward, acted on greedily; credit in real time or step by step",
    source="Knox & Stone 2009; windows and silence after Knox's code",
    parameters=TamerParameters,
    learn=learn,
    begin=begin,
    asks_after=AnswerKind.REWARD,
    scalars=MODEL_SCALARS,
    trail=TRAIL_COLUMNS,
)
