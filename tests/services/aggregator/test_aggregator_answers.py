import msgspec
import pytest

from protocol.codec import decode, encode
from protocol.journal import Record, read_answer_body
from protocol.messages import Acknowledgement, Answer, Control, Join, Refusal, SessionQuery, SessionReport
from protocol.who_said import said_to_a_crowd, said_to_a_learner
from services.runtime.bus import Reply
from services.runtime.memory_bus import MemoryBus
from tests.services.aggregator.crowd_room import CROWD_KEYS, EARLY, CrowdRoom, Member
from tests.services.learner.classroom import KEYS, Pupil, session


def test_a_crowd_agrees_and_the_learner_gets_one_answer_with_its_posterior(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, bob, cat = crowd_room.members("ann", "bob", "cat")
    codes = [ann.label("UP"), bob.label("UP"), cat.label("LEFT")]
    (handed,) = crowd_room.learner_answers()
    posterior = handed.posterior or {}
    assert codes == ["accepted"] * 3
    assert (handed.teacher, handed.decision, handed.kind, handed.action) == ("crowd", 0, "label", "UP")
    assert (sorted(posterior), max(posterior, key=lambda name: posterior[name])) == (
        ["DOWN", "LEFT", "RIGHT", "UP"],
        "UP",
    )
    assert sum(posterior.values()) == pytest.approx(1.0)
    assert [(step.label, [said.teacher for said in step.said]) for step in crowd_room.steps] == [
        ("UP", ["crowd"])
    ]


def test_members_see_the_session_under_their_own_deployment(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(window=EARLY))
    (ann,) = crowd_room.members("ann")
    welcome = ann.join()
    seen, behind = crowd_room.asked, crowd_room.decision
    assert seen == msgspec.structs.replace(
        behind, epoch=1, sequence=seen.sequence, remaining_ms=900, teachers=(), teachers_present=1
    )
    assert (welcome.rights, welcome.decision) == (("answer",), seen)


def test_many_who_join_at_once_are_announced_once(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    crowd_room.members("ann")
    before = len(crowd_room.seen)
    crowd_room.members(*(f"w{number}" for number in range(50)))
    assert len(crowd_room.seen) == before
    crowd_room.pass_time(200)
    assert [decision.teachers_present for decision in crowd_room.seen[before:]] == [51]


def test_a_decision_that_overtakes_the_crowd_is_announced_once(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(window=msgspec.structs.replace(EARLY, quorum=1)))
    ann, _bob = crowd_room.members("ann", "bob")
    tom = Pupil(crowd_room, "tom")
    tom.join()
    ann.label("UP")
    before = len(crowd_room.seen)
    tom.label(crowd_room.decision, "LEFT")
    seen = [(one.decision, one.phase) for one in crowd_room.seen[before:] if one.decision == 1]
    assert seen == [(1, "asking")]


def test_an_answer_is_acknowledged_only_when_it_is_in_the_crowds_own_journal(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, _ = crowd_room.members("ann", "bob")
    message = ann.message(crowd_room.asked, action="UP")
    reply = decode(ann.send(message).payload, Acknowledgement)
    (row,) = crowd_room.crowd_rows("answer")
    assert (row.seq, row.unique, row.person) == (reply.journal_seq, message.answer_id, "ann")
    assert row.body is not None
    assert decode(read_answer_body(row.body)[2], Answer) == message
    assert crowd_room.rows("answer") == []


def test_a_repeat_gets_the_same_acknowledgement_and_another_content_is_a_conflict(
    crowd_room: CrowdRoom,
) -> None:
    crowd_room.create()
    ann, bob = crowd_room.members("ann", "bob")
    message = ann.message(crowd_room.asked, action="UP")
    first = ann.send(message)
    bob.label("UP")
    again = ann.send(message)
    other = decode(ann.send(msgspec.structs.replace(message, action="LEFT")).payload, Acknowledgement)
    assert again == first
    assert other.code == "conflict"
    assert [row.kind for row in crowd_room.crowd_rows() if row.person == "ann"] == [
        "joined", "answer", "reliability", "conflict",
    ]  # fmt: skip


def test_a_token_is_never_journaled(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    ann.send(ann.message(crowd_room.asked, action="UP", token="signed-by-nobody"))  # noqa: S106 - an example
    assert not any(b"signed-by-nobody" in (row.body or b"") for row in crowd_room.crowd_rows())


def test_who_has_not_joined_is_denied(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    crowd_room.members("ann")
    stranger = Member(crowd_room, "eve")
    reply = stranger.send(stranger.message(crowd_room.asked, action="UP"))
    assert decode(reply.payload, Refusal) == Refusal(
        code="denied", reason="join session s1 before you answer"
    )


def test_nobody_answers_in_anothers_name(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, bob = crowd_room.members("ann", "bob")
    key = CROWD_KEYS.answer("s1", "bob")
    refusal = crowd_room.refused(key, ann.message(crowd_room.asked, action="UP"))
    assert refusal.code == "denied"
    assert crowd_room.crowd_rows("answer") == []
    assert bob.label("UP") == "accepted"


@pytest.mark.parametrize(
    "change,code,reason",
    [
        (
            {"action": "JUMP"},
            "invalid",
            "action 'JUMP' is not of this session: use one of LEFT, RIGHT, UP, DOWN",
        ),
        (
            {"action": None},
            "invalid",
            "a label names an action: use one of LEFT, RIGHT, UP, DOWN, or the kind abstain",
        ),
    ],
)
def test_an_answer_that_says_nothing_possible_is_refused(
    crowd_room: CrowdRoom, change: dict[str, object], code: str, reason: str
) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    message = ann.message(crowd_room.asked, **{"action": "UP"} | change)
    assert crowd_room.refused(CROWD_KEYS.answer("s1", "ann"), message) == Refusal(code=code, reason=reason)  # type: ignore[arg-type]
    assert crowd_room.aggregator is not None
    desk = crowd_room.aggregator.reception.desk
    assert (desk.malformed, desk.invalid) == ({}, {("s1", "ann"): 1})
    assert desk.refusals() == {"invalid": 1}


def test_garbage_is_counted_by_its_sender(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    crowd_room.members("ann")
    for _ in range(3):
        assert crowd_room.refused(CROWD_KEYS.answer("s1", "ann"), b"\xc1").code == "malformed"
    assert crowd_room.aggregator is not None
    assert crowd_room.aggregator.reception.desk.malformed == {("s1", "ann"): 3}


def test_a_session_that_the_learner_does_not_have_has_no_crowd(crowd_room: CrowdRoom) -> None:
    join = Join(session="s9", teacher="ann")
    refusal = crowd_room.refused(CROWD_KEYS.join("s9", "ann"), join)
    reason = "the learner says: no session s9 here: `sfid session list` shows what there is"
    assert refusal == Refusal(code="unknown-session", reason=reason)
    assert crowd_room.aggregator is not None
    assert crowd_room.aggregator.crowds == {}


def test_an_answer_for_an_unknown_session_creates_nothing(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    message = msgspec.structs.replace(ann.message(crowd_room.asked, action="UP"), session="s9")
    assert crowd_room.refused(CROWD_KEYS.answer("s9", "ann"), message).code == "unknown-session"
    assert crowd_room.aggregator is not None
    assert list(crowd_room.aggregator.crowds) == ["s1"]


def test_a_member_does_not_change_the_window_of_all(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    crowd_room.members("ann")
    wish = Control(session="s1", teacher="ann", verb="pause")
    assert crowd_room.refused(CROWD_KEYS.control("s1", "ann"), wish).code == "denied"
    assert crowd_room.decision.paused is False


def test_questions_about_sessions_are_passed_on_to_the_learner(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    query = SessionQuery(session="s1")
    direct = crowd_room.ask(crowd_room.watcher, KEYS.learner("show"), query)
    passed_on = crowd_room.ask(crowd_room.watcher, CROWD_KEYS.learner("show"), query)
    assert decode(passed_on.payload, SessionReport) == decode(direct.payload, SessionReport)
    assert (
        crowd_room.refused(CROWD_KEYS.learner("show"), SessionQuery(session="s9")).code == "unknown-session"
    )


def test_a_crowd_and_a_direct_teacher_teach_side_by_side(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, bob = crowd_room.members("ann", "bob")
    tom = Pupil(crowd_room, "tom")
    tom.join()
    ann.label("UP")
    bob.label("UP")
    assert crowd_room.decision.decision == 0
    tom.label(crowd_room.decision, "LEFT")
    said = [[(one.teacher, one.action) for one in step.said] for step in crowd_room.steps]
    assert said == [[("crowd", "UP"), ("tom", "LEFT")]]


def test_what_the_agent_learnt_reaches_the_crowd(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    ann.label("UP")
    assert crowd_room.crowd_measures == [encode(crowd_room.steps[0])]


def test_who_said_what_and_when_is_in_the_two_journals_together(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, bob = crowd_room.members("ann", "bob")
    asked_at_ns = crowd_room.crowd_rows("asked")[0].at_ns
    crowd_room.pass_time(400)
    ann.label("UP")  # 250 ms after it was shown
    crowd_room.pass_time(100)
    bob.say(kind="abstain", response_ms=None)
    to_crowd = list(said_to_a_crowd(records(crowd_room.crowd_rows()), "crowd"))
    (to_learner,) = said_to_a_learner(records(crowd_room.rows()))
    ms = 1_000_000
    told = [
        (one.teacher, one.via, one.kind, one.action, one.code, one.shown_ns, one.answered_ns)
        for one in to_crowd
    ]
    assert told == [
        ("ann", "crowd", "label", "UP", "accepted", (asked_at_ns, asked_at_ns + 150 * ms),
         (asked_at_ns + 250 * ms, asked_at_ns + 400 * ms)),
        ("bob", "crowd", "abstain", None, "accepted", (asked_at_ns, asked_at_ns + 500 * ms),
         (asked_at_ns, asked_at_ns + 500 * ms)),
    ]  # fmt: skip
    assert {one.handed for one in to_crowd} == {to_learner.answer_id}
    assert (to_learner.teacher, to_learner.action, to_learner.response_ms) == ("crowd", "UP", 500)


def records(rows: object) -> list[Record]:
    return [Record(row.kind, row.at_ns, row.body) for row in rows]  # type: ignore[attr-defined]


def test_a_join_that_waits_for_the_learner_is_answered_when_it_comes(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    crowd_room.kill_learner()
    bus, replies = MemoryBus(crowd_room.hub), list[Reply | None]()
    join = encode(Join(session="s1", teacher="ann"))
    bus.ask(CROWD_KEYS.join("s1", "ann"), join, replies.append, 60_000)
    crowd_room.hub.deliver_all()
    assert crowd_room.aggregator is not None
    crowd_room.aggregator.turn(0.0)
    assert replies == []
    crowd_room.start_learner()
    crowd_room.pass_time(1_000)
    assert [reply is not None and reply.ok for reply in replies] == [True]
