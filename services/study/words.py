"""The screens of a study: what a participant reads and is asked at each step."""

from services.screens import Button, Field, FieldKind, Screen
from sfid_core.learning.methods import METHODS
from sfid_core.study.definition import TEXT_LENGTH_MAX, Recruiter, Study
from sfid_core.study.effort import HIGH, LOW, SCALES, STEP
from sfid_core.study.flow import Progress, Standing, Step, StepKind, present_step

STOP = "stop"
"""The screen that asks what stopping is to mean, and the button that leads there."""
AGREE, DECLINE, GO, SEND, ANSWER = "agree", "decline", "go", "send", "answer"
GO_ON, STOP_KEEP, STOP_DELETE = "go-on", "stop-keep", "stop-delete"
LABELS = """\
The agent asks you which way you would go, and then decides by itself. When it goes the way you said, it
learns that this was good; when it goes another way, that it was not.

Say the way with the arrow keys or the arrow buttons, or swipe. If you do not know, say nothing (space)."""
REWARDS = """\
The agent makes a move by itself, and then asks you whether it was a good one. What you praise it will do more
often, what you blame less.

Praise with + and blame with -, on the keys or the buttons. If you do not know, say nothing (space)."""
AIM = "The agent pushes boxes onto goals. It does not know how; you teach it."
PROLIFIC_URL = "https://app.prolific.com/submissions/complete?cc="
_STOP_BUTTON = Button(STOP, "Stop taking part", fills=False, danger=True)
_DELETE_BUTTON = Button(
    STOP_DELETE,
    "Delete my answers",
    fills=False,
    danger=True,
    confirm="Everything that you answered is deleted. This cannot be undone. Delete it?",
)


def screen_of(study: Study, progress: Progress, pseudonym: str) -> Screen:
    """Return what a participant sees now."""
    if progress.stopping:
        return _stop()
    over = _over(study, progress)
    return _step(study, progress, pseudonym) if over is None else over


def _over(study: Study, progress: Progress) -> Screen | None:
    """Return what those see who left before the end."""
    match progress.standing:
        case Standing.DECLINED:
            nothing = "Nothing was stored but that. You can close this page."
            return Screen("declined", "You do not take part", (nothing,))
        case Standing.WITHDRAWN:
            return Screen("withdrawn", "You have stopped", _after_stopping(study), buttons=(_DELETE_BUTTON,))
        case Standing.ERASED:
            gone = "Your answers are left out of everything from now on, and deleted."
            return Screen("erased", "You have stopped", (gone, *_after_stopping(study)))
        case _:
            return None


def _step(study: Study, progress: Progress, pseudonym: str) -> Screen:
    step = present_step(study, progress)
    match step.kind:
        case StepKind.CONSENT:
            return _consent(study)
        case StepKind.READ:
            return _introduction(study, progress, step)
        case StepKind.TEACH:
            session = study.session(pseudonym, step.period)
            return Screen(step.name, step_title(study, step), session=session, buttons=(_STOP_BUTTON,))
        case StepKind.RATE:
            return _effort(study, step)
        case StepKind.ASK:
            return _questions(study, step)
        case StepKind.DONE:
            return _done(study, progress)


def step_title(study: Study, step: Step) -> str:
    """Return what a step is called for those who take part."""
    lesson = "Your lesson" if study.periods == 1 else f"Lesson {step.period} of {study.periods}"
    return "Practice" if step.period == 0 else lesson


def paragraphs(text: str) -> tuple[str, ...]:
    """Return a text's paragraphs, parted by empty lines."""
    return tuple(" ".join(part.split()) for part in text.split("\n\n") if part.strip())


def _consent(study: Study) -> Screen:
    agreed = "I have read this, I am of age, and I take part of my own free will."
    return Screen(
        "consent",
        study.title,
        paragraphs(study.consent.text),
        fields=(Field("agreed", FieldKind.CHECK, agreed),),
        buttons=(Button(AGREE, "Take part"), Button(DECLINE, "No, thank you", fills=False, danger=True)),
    )


def _introduction(study: Study, progress: Progress, step: Step) -> Screen:
    condition = study.conditions[progress.order[max(0, step.period - 1)]]
    if condition.instructions:
        told = paragraphs(condition.instructions)
    else:
        asked_after = METHODS[condition.method].asks_after is not None
        told = (AIM, *paragraphs(REWARDS if asked_after else LABELS))
    lesson = study.lesson(step.period)
    rounds = "one round" if lesson.episodes == 1 else f"{lesson.episodes} rounds"
    if step.period == 0:
        last = f"First you practise, {rounds} that will not count. Take your time."
    else:
        last = f"Now it counts: {rounds} with an agent that knows nothing yet."
    return Screen(
        step.name,
        step_title(study, step),
        (*told, last),
        buttons=(Button(GO, "Begin"), _STOP_BUTTON),
    )


def _effort(study: Study, step: Step) -> Screen:
    what = "the lesson" if study.periods == 1 else f"lesson {step.period}, the one you have just finished"
    fields = tuple(
        Field(
            scale.name,
            FieldKind.SCALE,
            f"{scale.dimension}: {scale.question}",
            low=LOW,
            high=HIGH,
            step=STEP,
            low_label=scale.low,
            high_label=scale.high,
        )
        for scale in SCALES
    )
    told = f"Six questions about {what}. Move each slider to where it is right for you."
    return Screen(step.name, "How much effort was it?", (told,), fields, (Button(SEND, "Send"), _STOP_BUTTON))


def _questions(study: Study, step: Step) -> Screen:
    fields = tuple(
        Field(
            one.name,
            FieldKind(one.kind.value),
            one.text,
            one.required,
            choices=one.choices,
            low=one.low,
            high=one.high,
            step=one.step,
            low_label=one.low_label,
            high_label=one.high_label,
            length_max=TEXT_LENGTH_MAX,
        )
        for one in study.questions
    )
    return Screen(step.name, "A few last questions", (), fields, (Button(ANSWER, "Send"), _STOP_BUTTON))


def _stop() -> Screen:
    return Screen(
        STOP,
        "Stop taking part?",
        (
            "You need not say why. What you answered so far can be kept for the research, or deleted.",
            "The lesson waits for you while you decide.",
        ),
        buttons=(
            Button(GO_ON, "Go on", fills=False),
            Button(STOP_KEEP, "Stop, keep my answers", fills=False, danger=True),
            Button(
                STOP_DELETE,
                "Stop, delete my answers",
                fills=False,
                danger=True,
                confirm=_DELETE_BUTTON.confirm,
            ),
        ),
    )


def _done(study: Study, progress: Progress) -> Screen:
    text: tuple[str, ...] = ("That was all. Your answers are saved.",)
    link = ""
    if study.recruiter is Recruiter.PROLIFIC and study.completion_code:
        text += ("Go back to Prolific with the button below, or enter this code there:",)
        link = PROLIFIC_URL + study.completion_code
    elif study.recruiter is Recruiter.NONE:
        text += ("This is your completion code, should somebody ask for it:",)
    else:
        text += ("Enter this code where you came from:",)
    return Screen(
        "done",
        "Thank you!",
        text,
        buttons=(_DELETE_BUTTON,),
        code=progress.code,
        link=link,
        link_label="Back to Prolific" if link else "",
    )


def _after_stopping(study: Study) -> tuple[str, ...]:
    last = "You can close this page. Thank you for your time."
    match study.recruiter:
        case Recruiter.PROLIFIC:
            return ("Please return your submission on Prolific.", last)
        case Recruiter.MTURK:
            return ("Please return the HIT.", last)
        case Recruiter.NONE:
            return (last,)
