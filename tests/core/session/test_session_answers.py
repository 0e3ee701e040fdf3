"""What becomes of an answer: accepted, superseded, late or rejected, and what it counts as."""

from dataclasses import asdict, replace

import pytest

from sfid_core.session.effects import Acknowledge, AnswerCode, Execute, Ignored, StepDone
from sfid_core.session.events import (
    AnswerGiven,
    Event,
    Paused,
    Restarted,
    Resumed,
    Stopped,
    TeacherLeft,
    WindowElapsed,
)
from sfid_core.session.state import Phase, Session
from sfid_core.teaching.answers import Answer, AnswerKind
from tests.core.session.script import (
    FULL,
    MS,
    PATIENT,
    STATES,
    abstention,
    answer_id,
    asked,
    in_phase,
    label,
    play,
    praise,
    snapshot,
    taken,
)


def told(code: AnswerCode, reason: str = "", number: int = 0) -> tuple[Acknowledge]:
    return (Acknowledge(answer_id(number), code, reason),)


def counted(**counts: int) -> dict[str, int]:
    names = ("submitted", "acknowledged", "applied", "superseded", "late", "rejected", "pending")
    return dict.fromkeys(names, 0) | counts


def tallied(session: Session) -> dict[str, int]:
    return {"acknowledged": session.counts.acknowledged, **asdict(session.counts)}


def test_an_answer_after_the_close_but_before_the_deadline_is_superseded() -> None:
    session = asked(teachers=("ann", "bob"))
    play(session, [(1, label("ann", 0)), (2, TeacherLeft("ann")), (3, abstention("bob"))])
    assert session.phase is Phase.EXECUTING
    assert play(session, [(1000, label("bob", 1, number=5))]) == [told(AnswerCode.SUPERSEDED, number=5)]
    assert tallied(session) == counted(submitted=2, acknowledged=2, superseded=1, pending=1)


def test_an_answer_after_the_deadline_is_late_and_changes_nothing_learnt() -> None:
    session = asked()
    agent = session.action
    play(session, [(1000, WindowElapsed()), (1001, taken(reward=1.0))])
    values = session.learner.values(STATES[0])
    assert play(session, [(1001, label("ann", agent, number=5))]) == [told(AnswerCode.LATE, number=5)]
    assert session.learner.values(STATES[0]) == values
    assert tallied(session) == counted(submitted=1, acknowledged=1, late=1)


def test_an_answer_to_an_earlier_decision_is_judged_by_that_decisions_deadline() -> None:
    session = asked()
    play(session, [(10, label("ann", 0)), (20, taken())])
    assert session.phase is Phase.ASKING
    assert play(session, [(1000, label("ann", 1, number=2)), (1001, label("ann", 1, number=3))]) == [
        told(AnswerCode.SUPERSEDED, number=2),
        told(AnswerCode.LATE, number=3),
    ]
    assert session.answers == {}


def test_an_answer_to_a_closed_window_without_a_deadline_is_superseded() -> None:
    session = asked(window=PATIENT)
    play(session, [(10, label("ann", 0))])
    assert play(session, [(10_000_000, label("ann", 1, number=2))]) == [told(AnswerCode.SUPERSEDED, number=2)]


def test_a_deadline_forgotten_after_many_decisions_makes_an_answer_late() -> None:
    session = asked(window=PATIENT)
    for decision in range(20):
        state = STATES[min(decision, 1)]
        play(session, [(decision, label("ann", 0, decision, state)), (decision, taken(decision))])
    assert play(session, [(30, label("ann", 0, 4, number=4)), (30, label("ann", 0, 3, number=3))]) == [
        told(AnswerCode.LATE, number=4),
        told(AnswerCode.LATE, number=3),
    ]
    assert play(session, [(30, label("ann", 0, 5, number=5))]) == [told(AnswerCode.SUPERSEDED, number=5)]


def test_the_second_answer_of_a_teacher_replaces_the_first() -> None:
    session = asked(window=FULL)
    agent = session.action
    play(session, [(1, label("ann", (agent + 1) % 4, number=1)), (2, label("ann", agent, number=2))])
    assert tallied(session) == counted(submitted=2, acknowledged=2, superseded=1, pending=1)
    play(session, [(1000, WindowElapsed()), (1001, taken())])
    assert session.learner.values(STATES[0])[agent] == 0.1
    assert tallied(session) == counted(submitted=2, acknowledged=2, superseded=1, applied=1)


def test_an_answer_to_a_decision_that_took_the_last_step_back_is_superseded() -> None:
    """In a replay without somebody's erased answers a window opens where nobody was asked."""
    session = asked(window=FULL)
    back = replace(taken(), action=session.learner.memory.actions)
    play(session, [(1, label("ann", 0)), (2, back)])
    assert tallied(session) == counted(submitted=1, acknowledged=1, superseded=1)
    assert (session.decision, session.learner.values(STATES[0])) == (1, (0.0,) * 4)


def test_a_step_that_comes_again_while_it_is_judged_changes_nothing() -> None:
    session = asked("reward")
    play(session, [(1, taken())])
    before = snapshot(session)
    for action in (1, session.learner.memory.actions):
        assert play(session, [(2, replace(taken(), action=action))]) == [
            (Ignored("no such step was to be taken"),)
        ]
    assert snapshot(session) == before


def test_a_step_that_was_asked_about_twice_tells_both_answers() -> None:
    session = asked("guidance")
    guidance = Answer(AnswerKind.GUIDANCE, guidance=(1,))
    judged = praise("ann", 1.0, number=2)
    effects = play(
        session,
        [(1, AnswerGiven("ann", answer_id(1), 0, STATES[0], guidance)), (2, taken()), (3, judged)],
    )
    (done,) = (effect for effect in effects[-1] if isinstance(effect, StepDone))
    assert done.measures.answers == (("ann", guidance), ("ann", judged.answer))


def test_an_abstention_that_comes_too_late_is_not_counted() -> None:
    session = asked()
    play(session, [(1000, WindowElapsed()), (1001, taken())])
    assert play(session, [(1001, abstention("ann", number=5))]) == [told(AnswerCode.LATE, number=5)]
    assert tallied(session) == counted()
    play(session, [(1002, label("ann", 0, 1, STATES[1]))])
    again = abstention("ann", 1, STATES[1], number=6)
    assert play(session, [(1003, again)]) == [told(AnswerCode.SUPERSEDED, number=6)]
    assert tallied(session) == counted(submitted=1, acknowledged=1, pending=1)


def test_a_label_after_an_abstention_replaces_nothing_that_was_counted() -> None:
    session = asked(teachers=("ann", "bob"))
    play(session, [(1, abstention("ann")), (2, label("ann", 1, number=2))])
    assert tallied(session) == counted(submitted=1, acknowledged=1, pending=1)


def test_an_abstention_takes_an_earlier_label_back() -> None:
    session = asked(window=FULL)
    play(session, [(1, label("ann", 0)), (2, abstention("ann", number=2)), (1000, WindowElapsed())])
    play(session, [(1001, taken())])
    assert tallied(session) == counted(submitted=1, acknowledged=1, superseded=1)
    assert session.learner.values(STATES[0]) == (0.0,) * 4


REJECTED: list[tuple[str, str, AnswerGiven, str]] = [
    ("sfid", "a teacher who did not join", label("eve", 0), "join the session before you answer"),
    ("sfid", "another kind", praise("ann", 1.0), "this session asks for label, not reward"),
    ("sfid", "a decision to come", label("ann", 0, decision=1), "that decision is not open yet"),
    ("sfid", "another state", label("ann", 0, state=STATES[1]), "that decision was asked for another state"),
    ("reward", "before the action was seen", praise("ann", 1.0), "that decision is not open yet"),
    ("q-learning", "nobody is asked", label("ann", 0), "this session asks for nothing, not label"),
]


@pytest.mark.parametrize(
    "method, event, reason",
    [pytest.param(method, event, reason, id=case) for method, case, event, reason in REJECTED],
)
def test_an_answer_to_nothing_that_was_asked_is_rejected_with_the_mend(
    method: str, event: AnswerGiven, reason: str
) -> None:
    session = asked(method)
    assert play(session, [(1, event)]) == [told(AnswerCode.REJECTED, reason)]
    assert tallied(session) == counted(submitted=1, rejected=1)
    assert session.answers == {}


@pytest.mark.parametrize("phase", [Phase.GATHERING, Phase.BEGINNING, Phase.READY])
def test_an_answer_before_its_decision_opened_is_rejected(phase: Phase) -> None:
    session = in_phase(phase, "sfid")
    session.teachers.add("ann")
    assert play(session, [(1, label("ann", 0, state=b""))]) == [
        told(AnswerCode.REJECTED, "that decision is not open yet")
    ]


@pytest.mark.parametrize("kind", [AnswerKind.GUIDANCE, AnswerKind.UNDO, AnswerKind.MISTAKE])
def test_kinds_that_the_method_does_not_ask_for_are_rejected(kind: AnswerKind) -> None:
    event = AnswerGiven("ann", answer_id(0), 0, STATES[0], Answer(kind, guidance=(1,), steps=(0, 1)))
    reason = f"this session asks for label, not {kind.value}"
    assert play(asked(), [(1, event)]) == [told(AnswerCode.REJECTED, reason)]


def test_a_teacher_who_left_joins_again_before_answering() -> None:
    session = asked(teachers=("ann", "bob"))
    assert play(session, [(1, TeacherLeft("ann")), (2, label("ann", 0))])[1] == told(
        AnswerCode.REJECTED, "join the session before you answer"
    )


def test_the_answer_to_a_decision_that_was_stopped_is_superseded_and_then_late() -> None:
    session = asked()
    assert play(
        session, [(1, Stopped("ann")), (2, label("ann", 0, number=1)), (1001, label("ann", 0, number=2))]
    )[1:] == [told(AnswerCode.SUPERSEDED, number=1), told(AnswerCode.LATE, number=2)]


def test_an_answer_during_a_pause_waits_for_the_resumption() -> None:
    session = asked()
    agent = session.action
    events: list[tuple[int, Event]] = [(1, Paused("ann")), (500, label("ann", agent)), (600, Resumed("ann"))]
    played = play(session, events)
    assert played[1] == told(AnswerCode.ACCEPTED)
    assert played[2][-1] == Execute(0, agent)


def test_after_a_restart_answers_to_earlier_decisions_are_late() -> None:
    session = asked()
    play(session, [(1, label("ann", 0)), (2, taken()), (3, Restarted(2))])
    assert play(session, [(4, label("ann", 0, number=9))]) == [told(AnswerCode.LATE, number=9)]


def test_after_a_restart_the_answer_to_the_decision_being_executed_is_late() -> None:
    session = asked()
    play(session, [(1, label("ann", 0)), (2, Restarted(2))])
    assert play(session, [(4, label("ann", 0, number=9))]) == [told(AnswerCode.LATE, number=9)]


def test_an_answer_at_the_very_deadline_is_in_time_as_long_as_the_window_is_open() -> None:
    session = asked()
    assert play(session, [(1000, label("ann", 0))])[0][0] == Acknowledge(answer_id(0), AnswerCode.ACCEPTED)
    assert session.deadline_ns is None
    assert (session.deadlines.of(0), len(session.deadlines)) == (1000 * MS, 1)
