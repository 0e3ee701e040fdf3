"""Simulated teachers by name, with the source of their numbers."""

from collections.abc import Mapping
from dataclasses import dataclass

from sfid_core.learning.parameters import ParameterError, Value, as_written, parameters_of
from sfid_core.teaching.kernels import TeacherParameters


@dataclass(frozen=True, slots=True)
class Persona:
    """A named simulated teacher."""

    summary: str
    parameters: TeacherParameters


def _persona(summary: str, **given: Value) -> Persona:
    return Persona(summary, parameters_of(TeacherParameters, given, summary))


PERSONAS: dict[str, Persona] = {
    "oracle": _persona("always right, never silent"),
    "expert": _persona(
        "the paper's first subject: 2 % of answers wrong, 2 % missing, praises what they would do (ours)",
        label_error=0.02,
        reward_error=0.02,
        silence=0.02,
        praises="preferred",
    ),
    "naive": _persona(
        "the paper's second subject: recalls what to do better (10 % wrong) than to judge what was seen "
        "(35 % wrong), 10 % missing (ours, after Bignold et al. 2020)",
        label_error=0.1,
        reward_error=0.35,
        silence=0.1,
        praises="preferred",
    ),
    "noisy": _persona("20 % of answers wrong", label_error=0.2, reward_error=0.2),
    "very-noisy": _persona("35 % of answers wrong", label_error=0.35, reward_error=0.35),
    "rare": _persona("answers one decision in four, correctly", silence=0.75),
    "moderate": _persona(
        "L = 0.5, C = 0.8 (Griffith et al. 2013, from memory)", label_error=0.2, reward_error=0.2, silence=0.5
    ),
    "weak": _persona(
        "L = 1, C = 0.55 (Griffith et al. 2013, from memory)", label_error=0.45, reward_error=0.45
    ),
    "absent-minded": _persona("30 % missing, the mean of 26 people (Cederborg et al. 2015)", silence=0.3),
    "balanced": _persona(
        "praises and blames alike (Loftin et al. 2015; values ours)", silence_right=0.1, silence_wrong=0.1
    ),
    "reward-focused": _persona(
        "praises, seldom blames (Loftin et al. 2015; values ours)", silence_right=0.0, silence_wrong=0.9
    ),
    "punishment-focused": _persona(
        "blames, seldom praises (Loftin et al. 2015; values ours)", silence_right=0.9, silence_wrong=0.0
    ),
    "inactive": _persona(
        "seldom says anything (Loftin et al. 2015; values ours)", silence_right=0.9, silence_wrong=0.9
    ),
    "positive": _persona("turns half of the blame into praise (after Thomaz & Breazeal 2006)", soften=0.5),
    "diminishing": _persona("praises the same thing ever less (after Li et al.)", diminishing=5.0),
    "fatiguing": _persona("answers ever less (ours)", fatigue=300.0),
    "drifting": _persona(
        "changes their mind after 200 decisions (after Loftin et al. 2015)", drift_after=200.0
    ),
    "slow": _persona("takes 0.5 to 2 s", delay="uniform", delay_min_ms=500.0, delay_max_ms=2000.0),
}


def persona_named(name: str, given: Mapping[str, Value] | None = None) -> TeacherParameters:
    """Return the named teacher, with the given parameters in place of theirs.

    Raises: ParameterError for an unknown name, an unknown parameter or a value out of range, and for a
    shortest delay that is above the longest.
    """
    if name not in PERSONAS:
        message = f"unknown teacher {name!r}: choose one of {', '.join(PERSONAS)}"
        raise ParameterError(message)
    own = as_written(PERSONAS[name].parameters)
    found = parameters_of(TeacherParameters, {**own, **(given or {})}, f"teacher {name}")
    if found.delay_min_ms > found.delay_max_ms:
        message = (
            f"delay_min_ms {found.delay_min_ms:g} is above delay_max_ms {found.delay_max_ms:g}: raise the "
            "longest or lower the shortest"
        )
        raise ParameterError(message)
    return found
