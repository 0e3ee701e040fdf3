"""The way through a study: every step in order, no step twice, none skipped, and out at any time."""

import itertools
from dataclasses import replace

import pytest

from sfid_core.study.assignment import order_of
from sfid_core.study.definition import Given, QuestionKind, Study
from sfid_core.study.errors import NotNow, StudyError
from sfid_core.study.flow import (
    Answered,
    Consented,
    Declined,
    Event,
    Joined,
    Progress,
    Rated,
    Read,
    Standing,
    StepKind,
    StopAsked,
    StopTakenBack,
    Taught,
    Withdrew,
    advance,
    fold,
    present_step,
    steps_of,
)
from tests.core.study.studies import CONSENT, QUESTIONS, study, within

ANSWERS: dict[str, Given] = {"hand": "left", "age": 44.0, "more": None}
RATINGS: tuple[int, ...] = (60, 5, 40, 20, 55, 0)
STUDIES = {
    "between": study(),
    "within": within(),
    "no practice": study(practice=None),
    "no effort": study(effort=False),
    "questions": study(questions=QUESTIONS),
    "bare": within(3, practice=None, effort=False),
}


def consented(of: Study, number: int = 0) -> Consented:
    names = tuple(of.conditions[place].name for place in order_of(of, number))
    return Consented(CONSENT.version, CONSENT.sha256, number, names)


def whole_way(of: Study) -> list[Event]:
    """Return what ends each step, from consent to done."""
    ends: dict[StepKind, type[Read | Taught]] = {StepKind.READ: Read, StepKind.TEACH: Taught}
    events: list[Event] = [Joined("c0de"), consented(of)]
    for step in steps_of(of)[1:-1]:
        match step.kind:
            case StepKind.RATE:
                events.append(Rated(step.name, RATINGS))
            case StepKind.ASK:
                events.append(Answered(step.name, ANSWERS))
            case _:
                events.append(ends[step.kind](step.name))
    return events


WAYS = [pytest.param(of, id=name) for name, of in STUDIES.items()]


def test_the_steps_are_consent_practice_teaching_and_effort_for_each_condition() -> None:
    assert [step.name for step in steps_of(within())] == [
        "consent", "practice-intro", "practice",
        "intro-1", "teach-1", "effort-1", "intro-2", "teach-2", "effort-2", "done",
    ]  # fmt: skip
    assert [step.name for step in steps_of(study(practice=None, effort=False))] == [
        "consent", "intro-1", "teach-1", "done",
    ]  # fmt: skip


@pytest.mark.parametrize("of", WAYS)
def test_each_step_ends_with_its_own_event_and_the_last_completes(of: Study) -> None:
    progress = Progress()
    seen = []
    for event in whole_way(of):
        progress = advance(of, progress, event)
        seen.append(present_step(of, progress).name)
    assert seen == ["consent", *(step.name for step in steps_of(of)[1:])]
    ratings = dict.fromkeys(range(1, of.periods + 1), RATINGS) if of.effort else {}
    assert progress == Progress(
        at=len(steps_of(of)) - 1, standing=Standing.COMPLETED, code="c0de", number=0,
        order=order_of(of, 0), consent=(CONSENT.version, CONSENT.sha256), ratings=ratings,
        answers=ANSWERS if of.questions else {},
    )  # fmt: skip


@pytest.mark.parametrize("of", WAYS)
def test_whoever_comes_back_at_any_step_stands_where_they_were(of: Study) -> None:
    events = whole_way(of)
    for come in range(len(events) + 1):
        live = Progress()
        for event in events[:come]:
            live = advance(of, live, event)
        assert fold(of, events[:come]) == live


@pytest.mark.parametrize("of", WAYS)
def test_at_each_step_only_its_own_event_is_taken(of: Study) -> None:
    events = whole_way(of)
    ending = events[1:]
    for place in range(len(ending)):
        progress = fold(of, events[: place + 1])
        for other, event in enumerate(ending):
            if other == place:
                advance(of, progress, event)
                continue
            with pytest.raises(NotNow, match=r"is done already|comes after"):
                advance(of, progress, event)
            assert progress == fold(of, events[: place + 1])


def test_a_step_that_is_submitted_twice_is_said_to_be_done() -> None:
    of = study()
    progress = fold(of, [*whole_way(of)[:2], Read("practice-intro")])
    with pytest.raises(NotNow, match="practice-intro is done already"):
        advance(of, progress, Read("practice-intro"))
    with pytest.raises(NotNow, match="teach-1 comes after practice"):
        advance(of, progress, Taught("teach-1"))
    with pytest.raises(NotNow, match="you have joined before"):
        advance(of, progress, Joined("other"))


@pytest.mark.parametrize("of", WAYS)
@pytest.mark.parametrize("erase", [False, True])
def test_one_can_withdraw_at_every_step_and_nothing_follows(of: Study, *, erase: bool) -> None:
    events = whole_way(of)
    for come, asked in itertools.product(range(1, len(events)), (False, True)):
        before = fold(of, [*events[:come], *([StopAsked()] if asked else [])])
        progress = advance(of, before, Withdrew(erase))
        assert progress.standing is (Standing.ERASED if erase else Standing.WITHDRAWN)
        assert progress.standing.is_kept is not erase
        assert (progress.at, progress.number, progress.stopping) == (before.at, before.number, False)
        assert (progress.ratings, progress.answers) == (
            ({}, {}) if erase else (before.ratings, before.answers)
        )
        for event in (*events[1:], StopAsked(), StopTakenBack(), Declined(), Withdrew(erase=False)):
            with pytest.raises(NotNow):
                advance(of, progress, event)


def test_who_stopped_or_completed_may_still_have_their_answers_deleted_once() -> None:
    of = study()
    for end in ([*whole_way(of)], [*whole_way(of)[:4], Withdrew(erase=False)]):
        progress = fold(of, [*end, Withdrew(erase=True)])
        assert (progress.standing, progress.ratings) == (Standing.ERASED, {})
        with pytest.raises(NotNow, match="deleted before"):
            advance(of, progress, Withdrew(erase=True))
    with pytest.raises(NotNow, match="it is over for you here: completed"):
        advance(of, fold(of, whole_way(of)), Withdrew(erase=False))


def test_asking_to_stop_is_kept_over_a_reload_and_can_be_taken_back() -> None:
    of = study()
    events = [*whole_way(of)[:5], StopAsked()]
    assert fold(of, events).stopping
    assert fold(of, [*events, StopTakenBack()]) == fold(of, events[:-1])


def test_a_session_that_ends_while_its_teacher_hesitates_leaves_the_question_standing() -> None:
    of = study()
    events = [*whole_way(of)[:5], StopAsked(), Taught("teach-1")]
    progress = fold(of, events)
    assert (present_step(of, progress).name, progress.stopping) == ("effort-1", True)


def test_who_declines_has_no_number_and_no_way_on() -> None:
    of = study()
    progress = fold(of, [Joined("c0de"), Declined()])
    assert progress == Progress(standing=Standing.DECLINED, code="c0de")
    assert not progress.standing.is_kept
    with pytest.raises(NotNow, match="declined"):
        advance(of, progress, consented(of))


def test_a_consent_with_the_conditions_of_another_number_is_refused() -> None:
    of = study()
    other = next(number for number in range(9) if order_of(of, number) != order_of(of, 0))
    wrong = Consented("1", CONSENT.sha256, other, consented(of).order)
    with pytest.raises(NotNow, match=f"participant {other} has other conditions"):
        advance(of, fold(of, [Joined("c0de")]), wrong)


@pytest.mark.parametrize(
    "ratings", [(), (50,) * 5, (50,) * 7, (50, 50, 50, 50, 50, 3), (105,) * 6, (-5,) * 6]
)
def test_ratings_that_are_not_on_the_scales_are_refused(ratings: tuple[int, ...]) -> None:
    of = study(practice=None)
    progress = fold(of, whole_way(of)[:4])
    with pytest.raises(NotNow, match=r"scale|ratings"):
        advance(of, progress, Rated("effort-1", ratings))


@pytest.mark.parametrize(
    "answers",
    [
        {},
        {"hand": "both"},
        {"hand": "left", "age": 17.0},
        {"hand": "left", "age": "44"},
        {"hand": "left", "more": "x" * 1001},
        {"hand": "left", "other": 1.0},
    ],
)
def test_answers_that_do_not_fit_their_questions_are_refused(answers: dict[str, Given]) -> None:
    of = study(questions=QUESTIONS)
    progress = fold(of, whole_way(of)[:-1])
    with pytest.raises(NotNow, match=r"no answer that fits|nobody asked"):
        advance(of, progress, Answered("questions", answers))


def test_what_was_left_out_is_none_in_the_order_of_the_questions() -> None:
    of = study(questions=QUESTIONS)
    progress = advance(
        of, fold(of, whole_way(of)[:-1]), Answered("questions", {"more": "fine", "hand": "left"})
    )
    assert list(progress.answers.items()) == [("hand", "left"), ("age", None), ("more", "fine")]
    with pytest.raises(StudyError, match="a choice has choices, and nothing else has"):
        replace(QUESTIONS[0], choices=())
    with pytest.raises(StudyError, match="low < high"):
        replace(QUESTIONS[1], low=200.0)
    with pytest.raises(StudyError, match="each a name of its own"):
        study(questions=QUESTIONS[:1] * 2)
    assert not QUESTIONS[1].takes("44")
    assert QUESTIONS[2].kind is QuestionKind.TEXT
