"""What a study's people did, and what it comes to: arms for the figure, differences with intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sfid_core.experiments.intervals import Floats
from sfid_core.experiments.summary import Arm, Measure
from sfid_core.outcome import Outcome
from sfid_core.session.measures import EpisodeMeasures
from sfid_core.study.definition import Given, Study
from sfid_core.study.flow import Standing


@dataclass(frozen=True, slots=True)
class Taught:
    """What a person's session came to."""

    episodes: tuple[EpisodeMeasures, ...]
    teaching_s: float
    answers: int
    is_whole: bool
    """Whether it came to its end, rather than being stopped or still going on."""


@dataclass(frozen=True, slots=True)
class Participant:
    """One person who agreed to take part, and whose answers may be used."""

    pseudonym: str
    number: int
    standing: Standing
    at: int
    conditions: tuple[str, ...]
    """By name, in the order of their periods."""
    consent: tuple[str, str]
    code: str
    began_s: float
    """Seconds since 1970."""
    seconds: float
    """From opening the page to the last thing they did."""
    lessons: Mapping[int, Taught]
    """By period, from 1."""
    ratings: Mapping[int, tuple[int, ...]]
    answers: Mapping[str, Given] = field(default_factory=dict)
    """To the study's own questions, by name."""

    def period_of(self, condition: str) -> int | None:
        """Return the period in which this person met a condition, None when they do not."""
        return self.conditions.index(condition) + 1 if condition in self.conditions else None


def whole(participants: Sequence[Participant], condition: str) -> list[Participant]:
    """Return those who taught a whole session in a condition, by number."""
    found = []
    for one in participants:
        period = one.period_of(condition)
        if period is not None and period in one.lessons and one.lessons[period].is_whole:
            found.append(one)
    return found


def arm_of(study: Study, condition: str, people: Sequence[Participant]) -> Arm:
    """Return a condition as an arm: a row a person, in the order given; each taught a whole session there."""
    described = next(one for one in study.conditions if one.name == condition)
    lessons = [one.lessons[one.period_of(condition) or 0] for one in people]
    measures = {measure: _table(lessons, measure) for measure in _MEASURES}
    totals: dict[str, Floats] = {
        "inputs_total": measures[Measure.INPUTS].sum(axis=1),
        "teaching_time_s": np.array([lesson.teaching_s for lesson in lessons]),
    }
    return Arm(described.method, label(study, condition), measures, totals)


def label(study: Study, condition: str) -> str:
    """Return the second part of an arm's name: its teachers, or the condition where that is ambiguous."""
    described = next(one for one in study.conditions if one.name == condition)
    alike = [
        one for one in study.conditions if (one.method, one.teacher) == (described.method, described.teacher)
    ]
    return described.teacher if len(alike) == 1 else condition


_MEASURES: dict[Measure, Callable[[EpisodeMeasures], float]] = {
    Measure.ABS_TD_ERROR: lambda one: one.abs_td_error,
    Measure.STEPS: lambda one: one.steps,
    Measure.DISCOUNTED_RETURN: lambda one: one.discounted_return,
    Measure.INPUTS: lambda one: one.inputs,
    Measure.ABS_TD_ERROR_SHAPED: lambda one: one.abs_td_error_shaped,
    Measure.DISCOUNTED_ENV_RETURN: lambda one: one.discounted_env_return,
    Measure.SOLVED: lambda one: one.outcome is Outcome.SOLVED,
}


def _table(lessons: Sequence[Taught], measure: Measure) -> Floats:
    read = _MEASURES[measure]
    return np.array([[float(read(episode)) for episode in lesson.episodes] for lesson in lessons])
