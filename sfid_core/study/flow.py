"""The way of one participant through a study, as a state machine: what was done, and what comes next.

`advance` is all of it; a participant is the fold of their events. No event skips a step: each names the step
that it ends, and is refused when that is not the present one.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache

from sfid_core.study.assignment import Order, order_of
from sfid_core.study.definition import Given, Study
from sfid_core.study.effort import checked_ratings
from sfid_core.study.errors import NotNow


class StepKind(Enum):
    """What a participant does in a step."""

    CONSENT = "consent"
    READ = "read"
    TEACH = "teach"
    RATE = "rate"
    ASK = "ask"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Step:
    """One step; period 0 is practice, the lessons count from 1."""

    name: str
    kind: StepKind
    period: int = 0


class Standing(Enum):
    """Where a participant stands in the study as a whole."""

    TAKING_PART = "taking part"
    DECLINED = "declined"
    COMPLETED = "completed"
    WITHDRAWN = "withdrawn"
    """Stopped early; what they answered is kept."""
    ERASED = "withdrawn, answers deleted"

    @property
    def is_kept(self) -> bool:
        """Whether the participant's answers may be used."""
        return self in {Standing.TAKING_PART, Standing.COMPLETED, Standing.WITHDRAWN}


# ---------------------------------------------------------------- events


@dataclass(frozen=True, slots=True)
class Joined:
    """Somebody opened the page for the first time."""

    code: str
    """Their completion code, shown at the end."""


@dataclass(frozen=True, slots=True)
class Consented:
    """They agreed to the text of that version and digest, as the number-th participant from 0."""

    version: str
    sha256: str
    number: int
    order: tuple[str, ...]
    """Names of the conditions that this number means, for whoever reads the data without the seed."""


@dataclass(frozen=True, slots=True)
class Declined:
    """They did not agree."""


@dataclass(frozen=True, slots=True)
class Read:
    """They have read a page."""

    step: str


@dataclass(frozen=True, slots=True)
class Taught:
    """Their session of the step has come to its end."""

    step: str


@dataclass(frozen=True, slots=True)
class Rated:
    """They filled in the effort questionnaire; ratings in the order of its scales."""

    step: str
    ratings: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Answered:
    """They answered the study's own questions, by name."""

    step: str
    answers: dict[str, Given]


@dataclass(frozen=True, slots=True)
class StopAsked:
    """They asked to stop, and are asked what is to become of their answers."""


@dataclass(frozen=True, slots=True)
class StopTakenBack:
    """They go on after all."""


@dataclass(frozen=True, slots=True)
class Withdrew:
    """They stopped, with or without the deletion of what they answered."""

    erase: bool


Event = (
    Joined | Consented | Declined | Read | Taught | Rated | Answered | StopAsked | StopTakenBack | Withdrew
)


# ---------------------------------------------------------------- state


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a participant has come."""

    at: int = 0
    """Index of the present step."""
    standing: Standing = Standing.TAKING_PART
    stopping: bool = False
    """Whether they are being asked what stopping is to mean."""
    code: str = ""
    number: int | None = None
    """By consent, from 0; None before it."""
    order: Order = ()
    consent: tuple[str, str] = ("", "")
    """Version and SHA-256 of the text that they agreed to."""
    ratings: dict[int, tuple[int, ...]] = field(default_factory=dict)
    """By period."""
    answers: dict[str, Given] = field(default_factory=dict)
    """To the study's own questions, by name."""


@cache
def _steps(*, practice: bool, effort: bool, questions: bool, periods: int) -> tuple[Step, ...]:
    steps = [Step("consent", StepKind.CONSENT)]
    if practice:
        steps += [Step("practice-intro", StepKind.READ), Step("practice", StepKind.TEACH)]
    for period in range(1, periods + 1):
        steps += [
            Step(f"intro-{period}", StepKind.READ, period),
            Step(f"teach-{period}", StepKind.TEACH, period),
        ]
        if effort:
            steps.append(Step(f"effort-{period}", StepKind.RATE, period))
    if questions:
        steps.append(Step("questions", StepKind.ASK, periods))
    return (*steps, Step("done", StepKind.DONE, periods))


def steps_of(study: Study) -> tuple[Step, ...]:
    """Return the steps of a study, consent first, done last."""
    return _steps(
        practice=study.practice is not None,
        effort=study.effort,
        questions=bool(study.questions),
        periods=study.periods,
    )


def present_step(study: Study, progress: Progress) -> Step:
    """Return the step that a participant is at, or was at when they stopped."""
    return steps_of(study)[progress.at]


def advance(study: Study, progress: Progress, event: Event) -> Progress:
    """Return the progress after an event. Raises NotNow where it does not fit; then nothing has changed."""
    match event:
        case Joined(code):
            if progress != Progress():
                raise NotNow("you have joined before")
            return replace(progress, code=code)
        case Withdrew(erase):
            return _withdrawn(progress, erase=erase)
    if progress.standing is not Standing.TAKING_PART:
        raise NotNow(f"it is over for you here: {progress.standing.value}")
    match event:
        case StopAsked() | StopTakenBack():
            return replace(progress, stopping=isinstance(event, StopAsked))
        case Declined():
            _expect(study, progress, StepKind.CONSENT, "consent")
            return replace(progress, standing=Standing.DECLINED, stopping=False)
        case Consented():
            return _consented(study, progress, event)
        case _:
            return _went_on(study, progress, event)


def _went_on(study: Study, progress: Progress, event: Read | Taught | Rated | Answered) -> Progress:
    match event:
        case Read(step):
            return _next(study, progress, _expect(study, progress, StepKind.READ, step))
        case Taught(step):
            # A session can come to its end while its teacher hesitates over stopping; they still are asked.
            return _next(study, progress, _expect(study, progress, StepKind.TEACH, step))
        case Rated(step, ratings):
            rated = _expect(study, progress, StepKind.RATE, step)
            found = progress.ratings | {rated.period: checked_ratings(ratings)}
            return _next(study, replace(progress, ratings=found), rated)
        case Answered(step, answers):
            asked = _expect(study, progress, StepKind.ASK, step)
            return _next(study, replace(progress, answers=_checked(study, answers)), asked)


def _checked(study: Study, answers: dict[str, Given]) -> dict[str, Given]:
    """Return the answers to all questions, in their order."""
    names = [question.name for question in study.questions]
    if answers.keys() - set(names):
        raise NotNow(f"answers to {', '.join(sorted(answers.keys() - set(names)))}: nobody asked that")
    for question in study.questions:
        if not question.takes(answers.get(question.name)):
            raise NotNow(f"question {question.name} has no answer that fits")
    return {name: answers.get(name) for name in names}


def fold(study: Study, events: Iterable[Event]) -> Progress:
    """Return the progress after all events of one participant."""
    progress = Progress()
    for event in events:
        progress = advance(study, progress, event)
    return progress


def _withdrawn(progress: Progress, *, erase: bool) -> Progress:
    """Stop, at any time; who completed or stopped before may still have their answers deleted."""
    if progress.standing is Standing.ERASED:
        raise NotNow("your answers have been deleted before")
    if not erase and progress.standing is not Standing.TAKING_PART:
        raise NotNow(f"it is over for you here: {progress.standing.value}")
    standing = Standing.ERASED if erase else Standing.WITHDRAWN
    kept = replace(progress, standing=standing, stopping=False)
    return replace(kept, ratings={}, answers={}) if erase else kept


def _consented(study: Study, progress: Progress, event: Consented) -> Progress:
    step = _expect(study, progress, StepKind.CONSENT, "consent")
    order = order_of(study, event.number)
    if event.order != tuple(study.conditions[place].name for place in order):
        raise NotNow(f"participant {event.number} has other conditions than {', '.join(event.order)}")
    agreed = (event.version, event.sha256)
    return _next(study, replace(progress, number=event.number, order=order, consent=agreed), step)


def _expect(study: Study, progress: Progress, kind: StepKind, name: str) -> Step:
    step = present_step(study, progress)
    if (step.kind, step.name) == (kind, name):
        return step
    done = any(earlier.name == name for earlier in steps_of(study)[: progress.at])
    raise NotNow(f"{name} is done already" if done else f"{name} comes after {step.name}: finish that first")


def _next(study: Study, progress: Progress, step: Step) -> Progress:
    at = steps_of(study).index(step) + 1
    last = at == len(steps_of(study)) - 1
    standing = Standing.COMPLETED if last else progress.standing
    return replace(progress, at=at, standing=standing, stopping=progress.stopping and not last)
