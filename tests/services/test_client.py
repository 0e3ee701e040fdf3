import msgspec
import pytest

from protocol.codec import decode, encode
from protocol.keys import KeyNameError
from protocol.messages import Acknowledgement, Answer, Control, Episode, Refusal, Step, Welcome, WindowSpec
from services.client import (
    AnswerState,
    AnswerUpdate,
    Client,
    Connection,
    Controlled,
    EpisodeOver,
    Learnt,
    Opened,
    Refused,
    Teaching,
    TeachingError,
    Update,
    Welcomed,
)
from services.client.client import INBOX_MAX, QUIET_MS
from services.outbox import Outbox
from services.runtime.bus import Request
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.teachers.fake_learner import KEYS, FakeLearner, decision, drop, refuse

SECOND_NS = 1_000_000_000


class Desk:
    """A client on a hub that delivers at once, and a clock moved by hand."""

    def __init__(self, outbox: Outbox | None = None, teacher: str = "ann", token: str | None = None) -> None:
        self.clock = ManualClock(SECOND_NS)
        self.hub = MemoryHub(self.clock, inline=True)
        self.bus = MemoryBus(self.hub)
        self.outbox = outbox or Outbox()
        self.client = Client(self.bus, KEYS, "s1", teacher, outbox=self.outbox, clock=self.clock, token=token)

    def learner(self) -> FakeLearner:
        return FakeLearner(MemoryBus(self.hub))

    def updates(self) -> list[Update]:
        found: list[Update] = []
        while (update := self.client.next(0)) is not None:
            found.append(update)
        return found

    def later(self, seconds: float = 1.0) -> list[Update]:
        """The updates of this time, the clock moved on in small steps."""
        found: list[Update] = []
        for _ in range(int(seconds * 20)):
            self.clock.advance(SECOND_NS // 20)
            found += self.updates()
        return found


def states(updates: list[Update]) -> list[AnswerState]:
    return [update.state for update in updates if isinstance(update, AnswerUpdate)]


def test_a_teacher_who_joins_is_welcomed_and_shown_the_open_decision() -> None:
    desk = Desk(token="secret")  # noqa: S106 - a test's
    learner = desk.learner()
    with desk.client:
        updates = desk.updates()
    welcome = Welcome(session="s1", epoch=1, rights=("answer", "window", "pause"), decision=learner.decision)
    assert updates == [
        Connection(connected=True, detail="connected to the router"),
        Welcomed(welcome),
        Opened(learner.decision, SECOND_NS),
    ]
    assert [(join.session, join.teacher, join.token) for join in learner.joins] == [("s1", "ann", "secret")]


def test_an_answer_copies_its_decision_and_is_saved_when_acknowledged() -> None:
    desk = Desk(token="secret")  # noqa: S106 - a test's
    learner = desk.learner()
    with desk.client as client:
        desk.updates()
        asked = learner.go_on(decision=7, episode=2, step=3, state=b"here", epoch=1)
        desk.updates()
        desk.clock.advance(250 * 1_000_000)
        answer_id = client.answer(asked, action="UP")
        updates = desk.updates()
    assert learner.answers == [
        Answer(
            answer_id=answer_id,
            session="s1",
            teacher="ann",
            epoch=1,
            decision=7,
            episode=2,
            step=3,
            state=b"here",
            kind="label",
            action="UP",
            response_ms=250,
            token="secret",  # noqa: S106 - a test's
        )
    ]
    acknowledgement = decode(learner.acknowledgement(learner.payloads[0]), Acknowledgement)
    assert updates == [
        AnswerUpdate(answer_id, AnswerState.SENDING),
        AnswerUpdate(answer_id, AnswerState.SAVED, acknowledgement, 1, ""),
    ]
    assert (client.unacknowledged, desk.outbox.pending()) == (0, [])


def test_an_answer_is_in_the_outbox_before_it_is_sent() -> None:
    desk = Desk()
    learner = desk.learner()
    kept: list[list[tuple[bytes, bytes]]] = []
    learner.on_answer = lambda _answer: kept.append(desk.outbox.pending())
    with desk.client as client:
        desk.updates()
        answer_id = client.answer(learner.decision, action="LEFT")
    assert kept == [[(answer_id, learner.payloads[0])]]


@pytest.mark.parametrize(
    "code,state",
    [
        ("accepted", AnswerState.SAVED),
        ("superseded", AnswerState.TOO_LATE),
        ("late", AnswerState.TOO_LATE),
        ("rejected", AnswerState.REJECTED),
        ("conflict", AnswerState.REJECTED),
    ],
)
def test_every_acknowledgement_is_final(code: str, state: AnswerState) -> None:
    desk = Desk()
    learner = desk.learner()
    learner.code = code  # type: ignore[assignment]
    with desk.client as client:
        desk.updates()
        client.answer(learner.decision, action="LEFT")
        found = states(desk.updates() + desk.later())
    assert found == [AnswerState.SENDING, state]
    assert (len(learner.payloads), desk.outbox.pending()) == (1, [])


def with_another_check(request: Request) -> None:
    """An acknowledgement of this id, but of other bytes."""
    reply = decode(FakeLearner(MemoryBus()).acknowledgement(request.payload), Acknowledgement)
    request.reply(encode(msgspec.structs.replace(reply, check=bytes(8))))


def of_another_answer(request: Request) -> None:
    answer = decode(request.payload, Answer)
    other = encode(msgspec.structs.replace(answer, answer_id=b"x" * 16))
    request.reply(FakeLearner(MemoryBus()).acknowledgement(other))


@pytest.mark.parametrize(
    "reply",
    [
        drop,
        refuse("busy"),
        refuse("not-durable"),
        refuse("unknown-session"),
        refuse("denied"),
        of_another_answer,
        with_another_check,
        lambda request: request.reply(b"\xc1 not a message"),
        lambda request: request.reply_error(b""),
    ],
    ids=[
        "no reply",
        "busy",
        "not durable",
        "unknown",
        "denied",
        "another's",
        "other bytes",
        "noise",
        "bare error",
    ],
)
def test_what_is_no_acknowledgement_makes_the_same_bytes_go_out_again(reply) -> None:  # type: ignore[no-untyped-def] # noqa: ANN001
    desk = Desk()
    learner = desk.learner()
    learner.answer_replies = [reply, reply]
    with desk.client as client:
        desk.updates()
        client.answer(learner.decision, action="LEFT")
        found = states(desk.updates() + desk.later())
    assert found == [AnswerState.SENDING, AnswerState.RETRYING, AnswerState.RETRYING, AnswerState.SAVED]
    assert learner.payloads == [learner.payloads[0]] * 3
    assert desk.outbox.pending() == []


def test_a_refusal_that_will_not_pass_rejects_the_answer_with_its_reason() -> None:
    desk = Desk()
    learner = desk.learner()
    learner.answer_replies = [refuse("malformed", "cut short")]
    with desk.client as client:
        desk.updates()
        answer_id = client.answer(learner.decision, action="LEFT")
        updates = desk.updates()
    assert updates[-1] == AnswerUpdate(answer_id, AnswerState.REJECTED, None, 1, "cut short")
    assert desk.outbox.pending() == []


def test_a_denied_answer_makes_the_teacher_join_again() -> None:
    desk = Desk()
    learner = desk.learner()
    learner.answer_replies = [refuse("denied")]
    with desk.client as client:
        desk.updates()
        client.answer(learner.decision, action="LEFT")
        desk.updates()
    assert len(learner.joins) == 2


def test_a_learner_that_goes_on_denying_is_not_asked_in_a_circle() -> None:
    desk = Desk()
    learner = desk.learner()
    learner.answer_replies = [refuse("denied")] * 50
    with desk.client as client:
        desk.updates()
        client.answer(learner.decision, action="LEFT")
        desk.updates()
    assert len(learner.joins) == 2
    assert len(learner.answers) <= 3


def test_answers_of_an_earlier_run_are_sent_once_the_teacher_is_welcome_again() -> None:
    outbox = Outbox()
    first = Desk(outbox)
    learner = first.learner()
    learner.answer_replies = [drop]
    with first.client as client:
        first.updates()
        answer_id = client.answer(learner.decision, action="LEFT")
        first.updates()
    outbox.store(b"of another teacher", encode(msgspec.structs.replace(learner.answers[0], teacher="bob")))

    second = Desk(outbox)
    again = second.learner()
    with second.client:
        updates = second.updates()
    assert again.payloads == learner.payloads
    assert [(update.answer_id, update.state) for update in updates if isinstance(update, AnswerUpdate)] == [
        (answer_id, AnswerState.SAVED)
    ]
    assert [key for key, _ in outbox.pending()] == [b"of another teacher"]


def test_only_a_newer_decision_is_shown() -> None:
    desk = Desk()
    learner = desk.learner()
    with desk.client:
        desk.updates()
        learner.publish(decision(sequence=5, decision=2))
        learner.publish(decision(sequence=4, decision=1))
        learner.publish(decision(sequence=5, decision=2))
        learner.publish(decision(sequence=6, decision=3))
        updates = desk.updates()
    assert [update.decision.sequence for update in updates if isinstance(update, Opened)] == [5, 6]


def test_a_learner_in_a_new_life_is_joined_again() -> None:
    desk = Desk()
    learner = desk.learner()
    with desk.client:
        desk.updates()
        learner.publish(decision(epoch=2, sequence=0))
        updates = desk.updates()
    assert len(learner.joins) == 2
    assert [type(update) for update in updates] == [Opened, Welcomed]


def test_a_session_created_anew_replaces_what_was_seen_before() -> None:
    desk = Desk()
    learner = desk.learner()
    learner.decision = decision(epoch=3, sequence=9)
    with desk.client:
        desk.updates()
        learner.decision = decision(epoch=1, sequence=0)
        updates = desk.later(QUIET_MS / 1000)
    assert [update.decision for update in updates if isinstance(update, Opened)] == [learner.decision]


def test_an_answer_rejected_by_a_learners_new_life_is_asked_for_again() -> None:
    desk = Desk()
    learner = desk.learner()
    learner.answer_replies = [drop]
    with desk.client as client:
        desk.updates()
        client.answer(learner.decision, action="LEFT")
        learner.code = "rejected"
        learner.publish(decision(epoch=2))
        before = client.has_answered(learner.decision)
        updates = desk.later()
        after = client.has_answered(learner.decision)
    assert [type(update) for update in updates][-2:] == [AnswerUpdate, Opened]
    assert (before, after) == (True, False)


def test_a_learner_that_is_not_there_yet_is_asked_again_and_the_wait_is_visible() -> None:
    desk = Desk()
    with desk.client:
        waiting = desk.updates() + desk.later(2)
        learner = desk.learner()
        updates = desk.later(1)
    details = [update.detail for update in waiting if isinstance(update, Connection) and not update.connected]
    assert 3 <= len(details) <= 8
    assert details[0] == "no learner answers for session 's1' yet (asked once); start it or wait"
    assert len(learner.joins) == 1
    assert any(isinstance(update, Welcomed) for update in updates)


def test_an_unknown_session_is_asked_for_again_and_a_denial_is_final() -> None:
    desk = Desk()
    learner = desk.learner()
    learner.join_refusal = Refusal(code="unknown-session", reason="create it")
    with desk.client:
        desk.updates()
        desk.later(1)
        joins = len(learner.joins)
        learner.join_refusal = Refusal(code="denied", reason="the token has expired")
        updates = desk.later(1)
        joins_then = len(learner.joins)
        desk.later(1)
    assert joins >= 2
    assert updates[-1] == Refused("denied", "the token has expired", final=True)
    assert len(learner.joins) == joins_then


def test_a_router_that_comes_back_is_joined_at_once() -> None:
    desk = Desk()
    learner = desk.learner()
    with desk.client:
        desk.updates()
        desk.bus.set_online(online=False)
        cut = desk.updates()
        desk.bus.set_online(online=True)
        updates = desk.updates()
    assert cut == [Connection(connected=False, detail="the router is gone, trying to reach it again")]
    assert [type(update) for update in updates] == [Connection, Welcomed]
    assert len(learner.joins) == 2


def test_a_decision_lost_on_the_way_is_found_by_joining_again_after_a_silence() -> None:
    desk = Desk()
    learner = desk.learner()
    with desk.client:
        desk.updates()
        learner.decision = decision(sequence=2, decision=1)
        soon = desk.later(QUIET_MS / 1000 - 0.2)
        updates = desk.later(0.4)
    assert soon == []
    assert [type(update) for update in updates] == [Welcomed, Opened]


def test_a_slow_caller_loses_messages_counted_and_gets_the_newest_state() -> None:
    desk = Desk()
    learner = desk.learner()
    with desk.client as client:
        desk.updates()
        for _ in range(INBOX_MAX + 10):
            learner.go_on()
        updates = desk.updates()
    assert client.dropped == 10
    assert isinstance(updates[-1], Opened)
    assert updates[-1].decision == learner.decision


def test_steps_and_episodes_are_handed_on_and_noise_is_counted() -> None:
    desk = Desk()
    learner = desk.learner()
    step = Step(
        session="s1", epoch=1, decision=0, episode=0, step=0, at_ns=1, state=b"", view="", action="UP", h=1.0,
        reward=0.0, td_error=0.1, td_error_shaped=0.2, outcome="running", next_view="", values=(0.0,) * 4,
    )  # fmt: skip
    episode = Episode(
        session="s1", epoch=1, decision=3, at_ns=2, episode=0, steps=4, abs_td_error=1.0,
        abs_td_error_shaped=1.0, discounted_return=1.0, discounted_env_return=1.0, inputs=4, agreements=3,
        outcome="solved",
    )  # fmt: skip
    with desk.client as client:
        desk.updates()
        learner.publish(step)
        learner.publish(episode)
        desk.bus.publish(KEYS.measures("s1"), b"\x00")
        desk.bus.publish(KEYS.decision("s1"), encode(step))
        updates = desk.updates()
    assert updates == [Learnt(step), EpisodeOver(episode)]
    assert client.unreadable == 2


def test_a_wish_is_sent_and_its_outcome_told() -> None:
    desk = Desk()
    learner = desk.learner()
    window = WindowSpec(mode="full", span_ms=500)
    with desk.client as client:
        desk.updates()
        client.control("window", window)
        told = desk.updates()
        learner.bus.close()
        client.control("pause")
        lost = desk.updates()
    assert learner.controls == [Control(session="s1", teacher="ann", verb="window", window=window)]
    assert told == [Opened(learner.decision, SECOND_NS), Controlled("window", ok=True)]
    assert lost == [Controlled("pause", ok=False, reason="the learner did not answer, try again")]


@pytest.mark.parametrize(
    "answer,reason",
    [
        ({"action": "JUMP"}, "action 'JUMP' is not one of LEFT, RIGHT, UP, DOWN"),
        ({}, "a label needs an action, one of LEFT, RIGHT, UP, DOWN"),
        ({"kind": "reward", "reward": 2.0}, "reward = 2.0: give a number from -1 to 1"),
        ({"kind": "nothing"}, "this decision asks for nothing: watch it, or abstain"),
    ],
)
def test_an_answer_that_does_not_fit_is_refused_before_it_is_kept(
    answer: dict[str, str], reason: str
) -> None:
    desk = Desk()
    with desk.client as client, pytest.raises(ValueError, match=reason.replace("(", ".")):
        client.answer(decision(), **answer)  # type: ignore[arg-type]
    assert desk.outbox.pending() == []


def test_a_teachers_name_must_fit_into_a_key() -> None:
    with pytest.raises(KeyNameError, match="teacher name 'Ann Lee' is not allowed"):
        Desk(teacher="Ann Lee")


def test_who_leaves_is_no_longer_present() -> None:
    desk = Desk()
    seen: list[tuple[str, bool]] = []
    MemoryBus(desk.hub).watch(KEYS.presences("s1"), lambda change: seen.append((change.key, change.present)))
    with desk.client as client:
        pass
    token = seen[0][0]
    assert KEYS.presence(token)[:2] == ("s1", "ann")
    assert seen == [(token, True), (token, False)]
    assert client.next(10) is None


def test_a_script_sees_each_decision_once_until_the_session_is_finished() -> None:
    desk = Desk()
    learner = desk.learner()

    def next_decision(answer: Answer) -> None:
        learner.go_on(phase="executing")
        if answer.decision == 3:
            learner.go_on(phase="finished")
        else:
            learner.go_on(phase="asking", decision=answer.decision + 1)
            learner.go_on(remaining_ms=10)

    learner.on_answer = next_decision
    with desk.client as client:
        teaching = Teaching(client)
        seen = []
        for asked in teaching.decisions():
            seen.append(asked.decision)
            teaching.answer(asked, action="LEFT" if asked.decision % 2 else None)
        left = client.drain(1)
    assert seen == [0, 1, 2, 3]
    assert [answer.kind for answer in learner.answers] == ["abstain", "label", "abstain", "label"]
    assert left == 0


def test_a_script_that_may_not_join_ends_with_the_learners_reason() -> None:
    desk = Desk()
    learner = desk.learner()
    learner.join_refusal = Refusal(code="denied", reason="no token")
    with desk.client as client, pytest.raises(TeachingError) as refused:
        next(Teaching(client).decisions())
    assert (str(refused.value), len(learner.joins)) == ("session 's1': no token (denied)", 1)
