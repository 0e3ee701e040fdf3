"""A study's data as tables: people, lessons, episodes, the effort, curves, claims. No identities."""

from collections.abc import Sequence

from services.exports.columns import CLAIM, DIFFERENCE_HI, DIFFERENCE_LO, EPISODE, MEASURE, METHOD
from services.exports.experiment_tables import MEASURES
from services.exports.table import Column, Kind, Table
from sfid_core.experiments.summary import Measure
from sfid_core.outcome import Outcome
from sfid_core.study.definition import QuestionKind, Study
from sfid_core.study.effort import SCALES, raw_score
from sfid_core.study.findings import Findings
from sfid_core.study.flow import steps_of
from sfid_core.study.results import Participant

_PERSON = Column(
    "participant", Kind.TEXT, "Pseudonym; who it is stands in a file of its own that is not here."
)
_CONDITION = Column("condition", Kind.TEXT, "Name of the condition.")
_PERIOD = Column("period", Kind.WHOLE, "Which of the person's lessons, from 1.")
_RATINGS = tuple(
    Column(
        scale.name, Kind.WHOLE, f"{scale.dimension}, from {scale.low} (0) to {scale.high} (100), steps of 5."
    )
    for scale in SCALES
)
_SCORE = Column(
    "effort_raw", Kind.NUMBER, "Raw score of the questionnaire: the plain mean of its six scales."
)
_MEASURED = (
    Measure.ABS_TD_ERROR,
    Measure.STEPS,
    Measure.DISCOUNTED_RETURN,
    Measure.DISCOUNTED_ENV_RETURN,
    Measure.INPUTS,
)


def study_tables(found: Findings) -> tuple[Table, ...]:
    """Return all tables of a study. Raises: ExportError."""
    study, people = found.study, found.participants
    return (
        _people(study, people),
        _lessons(study, people),
        _episodes(people),
        *((_answers(study, people),) if study.questions else ()),
        _curves(found),
        _effort(found),
        _claims(found),
    )


def _people(study: Study, people: Sequence[Participant]) -> Table:
    columns = (
        _PERSON,
        Column("number", Kind.WHOLE, "By consent, from 0; the assignment follows from it and the seed."),
        Column("standing", Kind.TEXT, "taking part, completed or withdrawn (with the answers kept)."),
        Column("step", Kind.TEXT, "The step they are at, or were at when they stopped."),
        Column("conditions", Kind.TEXT, "Their conditions in the order of their lessons, parted by spaces."),
        Column("consent_version", Kind.TEXT, "Version of the text that they agreed to."),
        Column("consent_sha256", Kind.TEXT, "SHA-256 of that text."),
        Column("duration_s", Kind.NUMBER, "From opening the page to the last thing they did.", "s"),
    )
    steps = steps_of(study)
    rows = [
        (
            *(one.pseudonym, one.number, one.standing.value, steps[one.at].name, " ".join(one.conditions)),
            *(*one.consent, round(one.seconds, 3)),
        )
        for one in people
    ]
    return Table.of_rows("participants", "Each row is one person who agreed to take part.", columns, rows)


def _lessons(study: Study, people: Sequence[Participant]) -> Table:
    columns = (
        _PERSON,
        _PERIOD,
        _CONDITION,
        Column("method", Kind.TEXT, "Learning method of the condition."),
        Column(
            "whole", Kind.TRUTH, "Whether the lesson came to its end; only those are in curves and claims."
        ),
        Column("episodes", Kind.WHOLE, "Episodes that were finished.", "episodes"),
        Column("answers", Kind.WHOLE, "Answers given, those included that came too late.", "answers"),
        Column(
            "teaching_time_s",
            Kind.NUMBER,
            "Time in which decisions were open, without the person's absences.",
            "s",
        ),
        *_RATINGS,
        _SCORE,
    )
    methods = {condition.name: condition.method for condition in study.conditions}
    rows: list[tuple[object, ...]] = []
    for one in people:
        for period, lesson in sorted(one.lessons.items()):
            condition = one.conditions[period - 1]
            ratings = one.ratings.get(period)
            given = (None,) * (len(SCALES) + 1) if ratings is None else (*ratings, raw_score(ratings))
            counts = (len(lesson.episodes), lesson.answers, lesson.teaching_s)
            rows.append(
                (one.pseudonym, period, condition, methods[condition], lesson.is_whole, *counts, *given)
            )
    return Table.of_rows(
        "lessons", "Each row is one lesson of one person; practice is not here.", columns, rows
    )


def _episodes(people: Sequence[Participant]) -> Table:
    columns = (
        _PERSON,
        _PERIOD,
        _CONDITION,
        EPISODE,
        *(MEASURES[measure] for measure in _MEASURED),
        MEASURES[Measure.SOLVED],
        Column("optimal_steps", Kind.WHOLE, "The fewest steps from the episode's start.", "steps"),
    )
    rows = [
        (
            *(one.pseudonym, period, one.conditions[period - 1], episode.episode),
            *(getattr(episode, measure.value) for measure in _MEASURED),
            *(episode.outcome is Outcome.SOLVED, episode.optimal_steps),
        )
        for one in people
        for period, lesson in sorted(one.lessons.items())
        for episode in lesson.episodes
    ]
    return Table.of_rows("episodes", "Each row is one episode of one lesson.", columns, rows)


def _answers(study: Study, people: Sequence[Participant]) -> Table:
    kinds = {QuestionKind.SCALE: Kind.NUMBER, QuestionKind.NUMBER: Kind.NUMBER}
    columns = (
        _PERSON,
        *(Column(one.name, kinds.get(one.kind, Kind.TEXT), one.text) for one in study.questions),
    )
    rows = [(one.pseudonym, *one.answers.values()) for one in people if one.answers]
    return Table.of_rows(
        "answers", "Each row is one person who answered the study's own questions.", columns, rows
    )


def _curves(found: Findings) -> Table:
    columns = (
        METHOD,
        Column("teacher", Kind.TEXT, "Second factor of the design, or the condition's name."),
        MEASURE,
        EPISODE,
        Column("mean", Kind.NUMBER, "Mean over people.", "that of the measure"),
        Column("lo", Kind.NUMBER, "Lower end of the mean's interval over people.", "that of the measure"),
        Column("hi", Kind.NUMBER, "Upper end of the mean's interval over people.", "that of the measure"),
        Column("people", Kind.WHOLE, "How many people.", "people"),
    )
    rows = [
        (arm.method, arm.teacher, measure.value, episode, mean, lo, hi, arm.n_seeds)
        for arm in found.summaries
        for measure, means in arm.means.items()
        for episode, (mean, (lo, hi)) in enumerate(
            zip(means.tolist(), arm.intervals[measure].tolist(), strict=True)
        )
    ]
    return Table.of_rows(
        "curves", "Each row is one measure of one episode over the people of a condition.", columns, rows
    )


def _effort(found: Findings) -> Table:
    columns = (
        _CONDITION,
        Column("scale", Kind.TEXT, "One of the six scales, or raw: their plain mean."),
        Column("mean", Kind.NUMBER, "Mean over people, 0 to 100."),
        Column("lo", Kind.NUMBER, "Lower end of the mean's interval; missing below two people."),
        Column("hi", Kind.NUMBER, "Upper end of the mean's interval; missing below two people."),
        Column("people", Kind.WHOLE, "How many people filled it in.", "people"),
    )
    names = [*(scale.name for scale in SCALES), "raw"]
    rows = [
        (one.condition, name, *map(float, (one.means[place], *one.intervals[place])), one.people)
        for one in found.effort
        for place, name in enumerate(names)
    ]
    return Table.of_rows(
        "effort", "Each row is one scale of the questionnaire in one condition.", columns, rows
    )


def _claims(found: Findings) -> Table:
    columns = (
        CLAIM,
        Column("verdict", Kind.TEXT, "shown, not shown, or too few people to say (below 10 in a condition)."),
        Column("mean_first", Kind.NUMBER, "Mean of the condition named first."),
        Column("mean_other", Kind.NUMBER, "Mean of the other condition."),
        Column("difference", Kind.NUMBER, "First minus other."),
        DIFFERENCE_LO,
        DIFFERENCE_HI,
        Column("level", Kind.NUMBER, "Coverage of the interval; all of the table hold at once at 95 %."),
        Column("people_first", Kind.WHOLE, "How many people in the first condition.", "people"),
        Column("people_other", Kind.WHOLE, "How many people in the other condition.", "people"),
    )
    rows = [
        (
            *(claim.sentence, claim.verdict, *(claim.means or (None, None)), claim.difference),
            *(claim.ci or (None, None)),
            *(claim.level, *claim.people),
        )
        for claim in found.claims
    ]
    return Table.of_rows("claims", "Each row is one claim.", columns, rows)
