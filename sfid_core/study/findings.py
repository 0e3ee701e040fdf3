"""All that the report of a study shows, from its people."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sfid_core.experiments.intervals import Floats, Resampling, exact_means, mean_intervals
from sfid_core.experiments.summary import ArmSummary, Measure, summarise
from sfid_core.study.claims import PeopleClaim, claims_of
from sfid_core.study.definition import Design, Study
from sfid_core.study.effort import SCALES, raw_score
from sfid_core.study.results import Participant, arm_of, whole

PEOPLE_FOR_INTERVAL = 2
WORDS = {
    Measure.STEPS: "steps an episode",
    Measure.INPUTS: "answers an episode",
    Measure.ABS_TD_ERROR: "|TD error|",
    Measure.DISCOUNTED_RETURN: "discounted return",
}
TIME, EFFORT = "teaching time (s)", "effort (raw score)"


@dataclass(frozen=True, slots=True, eq=False)
class EffortSummary:
    """The questionnaire of one condition over those who filled it in."""

    condition: str
    people: int
    means: Floats
    """Float64 [7]: the six scales in their order, then the raw score; not numbers below one person."""
    intervals: Floats
    """Float64 [7, 2]; not numbers below two people."""


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """What a study comes to so far."""

    study: Study
    participants: Sequence[Participant]
    people: Mapping[str, int]
    """By condition: who taught a whole session in it."""
    summaries: tuple[ArmSummary, ...]
    """Of conditions with two people or more, in the order of the study."""
    effort: tuple[EffortSummary, ...]
    claims: tuple[PeopleClaim, ...]


def find(study: Study, participants: Sequence[Participant], resampling: Resampling) -> Findings:
    """Return what the people of a study show. Raises: ExperimentError."""
    names = [condition.name for condition in study.conditions]
    wholes = {name: whole(participants, name) for name in names}
    arms = [
        arm_of(study, name, people) for name, people in wholes.items() if len(people) >= PEOPLE_FOR_INTERVAL
    ]
    rated = {name: _ratings(participants, name) for name in names}
    measured: dict[str, dict[str, dict[str, float]]] = {
        words: {name: _means(people, name, measure) for name, people in wholes.items()}
        for measure, words in WORDS.items()
    }
    measured[TIME] = {
        name: {one.pseudonym: one.lessons[one.period_of(name) or 0].teaching_s for one in people}
        for name, people in wholes.items()
    }
    if study.effort:
        measured[EFFORT] = {
            name: {who: raw_score(given) for who, given in ratings.items()} for name, ratings in rated.items()
        }
    return Findings(
        study=study,
        participants=participants,
        people={name: len(people) for name, people in wholes.items()},
        summaries=summarise(arms, resampling),
        effort=tuple(_effort(name, list(rated[name].values()), resampling) for name in names if study.effort),
        claims=claims_of(names, measured, resampling, paired=study.design is Design.WITHIN),
    )


def _means(people: Sequence[Participant], condition: str, measure: Measure) -> dict[str, float]:
    """Return each person's mean over the episodes of their session."""
    found = {}
    for one in people:
        episodes = one.lessons[one.period_of(condition) or 0].episodes
        values = np.array([float(getattr(episode, measure.value)) for episode in episodes])
        found[one.pseudonym] = float(exact_means(values))
    return found


def _ratings(participants: Sequence[Participant], condition: str) -> dict[str, tuple[int, ...]]:
    found = {one.pseudonym: one.ratings.get(one.period_of(condition) or 0, ()) for one in participants}
    return {who: ratings for who, ratings in found.items() if ratings}


def _effort(condition: str, ratings: Sequence[tuple[int, ...]], resampling: Resampling) -> EffortSummary:
    width = len(SCALES) + 1
    rows = np.array([[*given, raw_score(given)] for given in ratings], dtype=np.float64).reshape(-1, width)
    means = exact_means(rows) if len(rows) else np.full(width, np.nan)
    enough = len(rows) >= PEOPLE_FOR_INTERVAL
    intervals = mean_intervals(rows, resampling) if enough else np.full((width, 2), np.nan)
    return EffortSummary(condition, len(rows), means, intervals)
