from typing import Any

import pytest

from sfid_core.crowd.round import (
    ROUNDS_KEPT,
    Acknowledged,
    Announce,
    Answered,
    Asked,
    Cause,
    Closed,
    Concluded,
    Crowd,
    Due,
    Effect,
    MemberJoined,
    MemberLeft,
    RoundSettings,
    advance,
)
from sfid_core.crowd.settings import CrowdMethod, CrowdSettings
from sfid_core.learning.parameters import ParameterError
from sfid_core.session.effects import AnswerCode
from sfid_core.teaching.answers import Answer, AnswerKind

MS = 1_000_000
LEFT, RIGHT, UP, DOWN = range(4)
ABSTAIN = Answer(AnswerKind.ABSTAIN)


def crowd(*names: str, method: CrowdMethod = CrowdMethod.MAJORITY, **rounds: int) -> Crowd:
    """A crowd of these members, asked for nothing yet."""
    weighing = CrowdSettings(method=method, influence_cap=1.0)
    made = Crowd(RoundSettings(**rounds), weighing, 4)
    for name in names:
        advance(made, 0, MemberJoined(name))
    return made


def asked(number: int = 0, kind: AnswerKind = AnswerKind.LABEL, **changes: Any) -> Asked:  # noqa: ANN401 - any field
    return Asked(number, b"s%d" % number, kind)._replace(**changes)


def label(action: int) -> Answer:
    return Answer(AnswerKind.LABEL, action)


def says(made: Crowd, worker: str, answer: Answer, at_ms: int = 0, number: int = 0) -> tuple[Effect, ...]:
    event = Answered(worker, worker.encode(), number, b"s%d" % number, answer)
    return advance(made, at_ms * MS, event)


def accepted(worker: str) -> Acknowledged:
    return Acknowledged(worker.encode(), AnswerCode.ACCEPTED)


def closed(made: Crowd, cause: Cause = Cause.QUORUM) -> Concluded:
    concluded, announce = advance(made, 0, Closed(cause))
    assert isinstance(concluded, Concluded)
    assert announce == Announce()
    return concluded


def test_a_round_is_due_when_everybody_present_has_answered() -> None:
    made = crowd("ann", "bob")
    assert advance(made, 0, asked()) == (Announce(),)
    assert says(made, "ann", label(UP)) == (accepted("ann"),)
    assert says(made, "bob", ABSTAIN) == (accepted("bob"), Due(Cause.QUORUM))


def test_a_quorum_of_a_number_closes_without_the_others() -> None:
    made = crowd("ann", "bob", "cat", quorum=2)
    advance(made, 0, asked())
    assert says(made, "ann", label(UP)) == (accepted("ann"),)
    assert says(made, "cat", label(UP)) == (accepted("cat"), Due(Cause.QUORUM))


def test_who_leaves_is_not_waited_for_and_what_they_said_counts() -> None:
    made = crowd("ann", "bob", "cat")
    advance(made, 0, asked())
    says(made, "ann", label(UP))
    assert advance(made, 0, MemberLeft("ann")) == (Announce(),)
    says(made, "bob", label(UP))
    assert advance(made, 0, MemberLeft("cat")) == (Announce(), Due(Cause.QUORUM))
    assert closed(made).answer == Answer(AnswerKind.LABEL, UP, posterior=(0.0, 0.0, 1.0, 0.0))


def test_the_last_member_to_leave_closes_a_round_that_has_answers_and_no_other() -> None:
    made = crowd("ann")
    advance(made, 0, asked())
    assert advance(made, 0, MemberLeft("ann")) == (Announce(),)
    advance(made, 0, MemberJoined("ann"))
    says(made, "ann", label(UP))
    assert made.round is not None
    assert advance(made, 0, MemberLeft("ann")) == (Announce(), Due(Cause.QUORUM))
    assert advance(made, 0, MemberLeft("ann")) == ()


@pytest.mark.parametrize(
    "remaining_ms,margin_ms,deadline_ms", [(2000, 100, 1900), (200, 100, 150), (0, 100, 0), (2000, 0, 2000)]
)
def test_the_deadline_is_a_margin_before_the_learners(
    remaining_ms: int, margin_ms: int, deadline_ms: int
) -> None:
    made = crowd("ann", margin_ms=margin_ms)
    advance(made, 5 * MS, asked(remaining_ms=remaining_ms))
    assert made.round is not None
    assert made.round.deadline_ns == (5 + deadline_ms) * MS


def test_without_a_deadline_the_first_answer_starts_the_patience() -> None:
    made = crowd("ann", "bob", patience_ms=3000)
    advance(made, 0, asked())
    assert made.round is not None
    assert made.round.deadline_ns is None
    says(made, "ann", label(UP), at_ms=10)
    advance(made, 20 * MS, asked())  # announced again: the patience runs on
    assert made.round.deadline_ns == 3010 * MS


def test_a_full_window_and_a_pause_close_at_no_quorum() -> None:
    for change in ("full", "held"):
        made = crowd("ann")
        advance(made, 0, asked(full=change == "full", held=change == "held"))
        assert says(made, "ann", label(UP)) == (accepted("ann"),)


def test_a_pause_takes_the_deadline_away_and_its_end_brings_it_back() -> None:
    made = crowd("ann", "bob", margin_ms=0)
    advance(made, 0, asked(remaining_ms=1000))
    says(made, "ann", label(UP))
    advance(made, 300 * MS, asked(held=True))
    open_round = made.round
    assert open_round is not None
    deadlines = [open_round.deadline_ns]
    says(made, "bob", label(UP), at_ms=400)
    effects = advance(made, 5000 * MS, asked(remaining_ms=700))
    deadlines.append(open_round.deadline_ns)
    assert (deadlines, effects) == ([None, 5700 * MS], (Announce(), Due(Cause.QUORUM)))


def test_the_last_answer_of_a_worker_counts() -> None:
    made = crowd("ann", "bob", "cat")
    advance(made, 0, asked())
    for worker, action in (("ann", LEFT), ("ann", UP), ("bob", UP), ("cat", DOWN)):
        says(made, worker, label(action))
    assert closed(made).answer == Answer(AnswerKind.LABEL, UP, posterior=(0.0, 0.0, 2 / 3, 1 / 3))


@pytest.mark.parametrize(
    "answers",
    [
        {"ann": label(UP), "bob": label(DOWN)},
        {"ann": label(UP), "bob": label(DOWN), "cat": label(UP), "dan": label(DOWN)},
        {"ann": ABSTAIN, "bob": ABSTAIN},
        {"ann": label(UP), "bob": label(UP), "cat": label(LEFT), "dan": label(RIGHT)},  # 0.5 < 0.6
    ],
)
def test_a_tie_silence_and_doubt_are_handed_on_as_an_abstention(answers: dict[str, Answer]) -> None:
    made = crowd(*answers)
    advance(made, 0, asked())
    for worker, answer in answers.items():
        says(made, worker, answer)
    handed = closed(made).answer
    assert handed is not None
    assert (handed.kind, handed.action, round(sum(handed.posterior), 12)) == (AnswerKind.ABSTAIN, None, 1.0)


def test_a_round_without_answers_hands_on_nothing() -> None:
    made = crowd("ann")
    advance(made, 0, asked())
    concluded = closed(made, Cause.DEADLINE)
    assert (concluded.answer, concluded.conclusion, made.conclusions, made.round) == (None, None, 0, None)


def test_a_round_that_the_learner_overtook_hands_on_nothing_but_is_learnt_from() -> None:
    made = crowd("ann", "bob", method=CrowdMethod.ONE_COIN)
    advance(made, 0, asked())
    says(made, "ann", label(UP))
    says(made, "bob", label(UP))
    concluded = closed(made, Cause.OVERTAKEN)
    assert (concluded.answer, made.conclusions) == (None, 1)
    assert made.aggregate(AnswerKind.LABEL).reliability("ann").labels == 1


@pytest.mark.parametrize(
    "answer,state,reason",
    [
        (Answer(AnswerKind.REWARD, UP, 1.0), b"s3", "this session asks for label, not reward"),
        (label(UP), b"other", "that decision was asked for another state"),
    ],
)
def test_what_answers_nothing_that_was_asked_is_rejected(answer: Answer, state: bytes, reason: str) -> None:
    made = crowd("ann")
    advance(made, 0, asked(3))
    effects = advance(made, 0, Answered("ann", b"id", 3, state, answer))
    assert effects == (Acknowledged(b"id", AnswerCode.REJECTED, reason),)


def test_a_reward_for_another_action_is_rejected() -> None:
    made = crowd("ann")
    advance(made, 0, asked(kind=AnswerKind.REWARD, judged=UP))
    effects = says(made, "ann", Answer(AnswerKind.REWARD, DOWN, 1.0))
    reason = "that decision led to another action"
    assert effects == (Acknowledged(b"ann", AnswerCode.REJECTED, reason),)


def test_after_the_close_an_answer_is_superseded_until_the_deadline_and_late_after_it() -> None:
    made = crowd("ann", "bob", margin_ms=0)
    advance(made, 0, asked(remaining_ms=1000))
    says(made, "ann", label(UP))
    closed(made)
    advance(made, 500 * MS, asked(1, remaining_ms=1000))
    codes = [
        says(made, "bob", label(UP), at_ms=at_ms, number=number)[0]
        for at_ms, number in ((1000, 0), (1001, 0), (1001, 2), (1001, 1))
    ]
    assert [effect.code.value for effect in codes if isinstance(effect, Acknowledged)] == [
        "superseded", "late", "rejected", "accepted",
    ]  # fmt: skip


def test_deadlines_of_a_bounded_number_of_rounds_are_remembered() -> None:
    made = crowd("ann")
    for number in range(100):
        advance(made, 0, asked(number))
        closed(made, Cause.DEADLINE)
    assert [decision for decision, _ in made.closed] == list(range(100 - ROUNDS_KEPT, 100))


def test_a_learner_that_was_killed_asks_again_what_it_had_not_kept() -> None:
    made = crowd("ann")
    for number in (4, 5, 6):
        advance(made, 0, asked(number))
        closed(made, Cause.DEADLINE)
    advance(made, 0, asked(5))
    assert says(made, "ann", label(UP), number=5) == (accepted("ann"), Due(Cause.QUORUM))
    assert [decision for decision, _ in made.closed] == [4]


def test_gold_measures_by_the_truth_whatever_the_crowd_came_to() -> None:
    made = crowd("ann", "bob", "cat", method=CrowdMethod.ONE_COIN)
    for number in range(30):
        advance(made, 0, asked(number, optimal=(UP,), gold=True))
        for worker, action in (("ann", UP), ("bob", DOWN), ("cat", DOWN)):
            says(made, worker, label(action), number=number)
        closed(made)
    known = made.aggregate(AnswerKind.LABEL)
    means = [known.reliability(worker).mean for worker in ("ann", "bob", "cat")]
    assert means[0] > 0.9
    assert max(means[1:]) < 0.1


def test_naming_another_optimum_costs_no_reliability() -> None:
    made, strict = (crowd("ann", "bob", "cat", method=CrowdMethod.ONE_COIN) for _ in range(2))
    for one, optimal in ((made, (LEFT, UP)), (strict, ())):
        for number in range(20):
            advance(one, 0, asked(number, optimal=optimal))
            for worker, action in (("ann", UP), ("bob", UP), ("cat", LEFT)):
                says(one, worker, label(action), number=number)
            closed(one)
    assert made.aggregate(AnswerKind.LABEL).reliability("cat").mean > 0.85
    assert strict.aggregate(AnswerKind.LABEL).reliability("cat").mean < 0.5


def test_two_optima_are_no_gold() -> None:
    made = crowd("ann", method=CrowdMethod.ONE_COIN)
    advance(made, 0, asked(optimal=(LEFT, UP), gold=True))
    says(made, "ann", label(UP))
    closed(made)
    assert made.aggregate(AnswerKind.LABEL).reliability("ann").mean == pytest.approx(5 / 7)


def test_what_is_optimal_was_settled_when_the_round_opened() -> None:
    made = crowd("ann")
    advance(made, 0, asked(optimal=(UP,), gold=True))
    advance(made, 0, asked(remaining_ms=500))
    assert made.round is not None
    assert made.round.asked == asked(remaining_ms=500, optimal=(UP,), gold=True)


def test_rewards_are_weighed_as_praise_and_blame_and_keep_their_size() -> None:
    made = crowd("ann", "bob", "cat", "dan")
    advance(made, 0, asked(kind=AnswerKind.REWARD, judged=UP))
    for worker, reward in (("ann", 1.0), ("bob", 0.5), ("cat", 0.75), ("dan", -1.0)):
        says(made, worker, Answer(AnswerKind.REWARD, UP, reward))
    # Three of four praise, by 0.75 on average: (0.75 - 0.25) * 0.75.
    assert closed(made).answer == Answer(AnswerKind.REWARD, UP, 0.375)


def test_a_reward_of_nothing_is_an_abstention() -> None:
    made = crowd("ann")
    advance(made, 0, asked(kind=AnswerKind.REWARD, judged=UP))
    says(made, "ann", Answer(AnswerKind.REWARD, UP, 0.0))
    concluded = closed(made)
    assert (concluded.answer, made.conclusions) == (ABSTAIN, 0)


def guides(*actions: int) -> Answer:
    return Answer(AnswerKind.GUIDANCE, guidance=actions)


@pytest.mark.parametrize(
    "said,handed",
    [
        ((guides(LEFT, UP), guides(UP), guides(UP, DOWN)), guides(UP)),
        ((guides(LEFT, UP), guides(UP, LEFT), guides(DOWN)), guides(LEFT, UP)),
        ((guides(LEFT), guides(UP), guides(DOWN)), ABSTAIN),
        ((ABSTAIN, ABSTAIN, guides(UP)), guides(UP)),
    ],
)
def test_guidance_is_what_more_than_half_of_those_who_guide_name(
    said: tuple[Answer, ...], handed: Answer
) -> None:
    made = crowd("ann", "bob", "cat")
    advance(made, 0, asked(kind=AnswerKind.GUIDANCE))
    for worker, answer in zip(("ann", "bob", "cat"), said, strict=True):
        says(made, worker, answer)
    assert closed(made).answer == handed
    assert made.aggregates == {}


def test_of_mistake_marks_the_one_that_most_make_is_handed_on_and_a_tie_is_silence() -> None:
    first, second = (Answer(AnswerKind.MISTAKE, UP, steps=steps) for steps in ((0, 2), (1, 1)))
    for said, handed in (((first, first, second), first), ((first, second, ABSTAIN), ABSTAIN)):
        made = crowd("ann", "bob", "cat")
        advance(made, 0, asked(kind=AnswerKind.MISTAKE))
        for worker, answer in zip(("ann", "bob", "cat"), said, strict=True):
            says(made, worker, answer)
        assert closed(made).answer == handed


def test_a_decision_that_is_asked_before_and_after_the_action_has_two_rounds() -> None:
    made = crowd("ann", "bob")
    advance(made, 0, asked(kind=AnswerKind.GUIDANCE, remaining_ms=1000))
    says(made, "ann", guides(UP))
    closed(made)
    advance(made, 10 * MS, asked(kind=AnswerKind.REWARD, judged=UP))
    late = says(made, "bob", guides(UP), at_ms=10)
    in_time = says(made, "ann", Answer(AnswerKind.REWARD, UP, 1.0), at_ms=10)
    assert late == (Acknowledged(b"bob", AnswerCode.SUPERSEDED),)
    assert in_time == (accepted("ann"),)


def test_closing_nothing_changes_nothing() -> None:
    made = crowd("ann")
    assert advance(made, 0, Closed(Cause.DEADLINE)) == ()
    assert made.closed == {}


@pytest.mark.parametrize(
    "wrong", [{"quorum": -1}, {"margin_ms": -1}, {"margin_ms": 60_001}, {"patience_ms": 0}]
)
def test_settings_out_of_range_are_refused_with_the_mend(wrong: dict[str, int]) -> None:
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        RoundSettings(**wrong)
