"""What becomes of every answer, who may do what, and that nothing is told before it is on the disk."""

import secrets
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from protocol.codec import decode, encode
from protocol.journal import read_answer_body
from protocol.messages import Acknowledgement, Answer, Control, Done, Join, Refusal, WindowSpec
from services.learner.config import LearnerConfig
from services.replay import replay_directory
from services.runtime.journal import JournalFull, Shard
from sfid_core.session.effects import AnswerCode
from tests.services.learner.classroom import KEYS, Classroom, Pupil, session, status

EARLY = WindowSpec(mode="early", span_ms=1_000)


@pytest.fixture
def ann(room: Classroom) -> Pupil:
    """A teacher in a session whose window closes by the clock."""
    room.create(session(window=WindowSpec(mode="full", span_ms=1_000)))
    pupil = Pupil(room, "ann")
    pupil.join()
    return pupil


def test_a_repeated_answer_gets_the_same_acknowledgement_to_the_byte_and_counts_once(
    room: Classroom, ann: Pupil
) -> None:
    answer = ann.message(room.decision, action="UP")
    first = ann.send(answer)
    room.pass_time(5_000)
    assert ann.send(answer) == first
    assert decode(first.payload, Acknowledgement).code == "accepted"
    assert len(room.rows("answer")) == 1
    assert room.report().labels.submitted == 1


def test_another_content_under_an_id_is_a_conflict_and_the_first_one_stays(
    room: Classroom, ann: Pupil
) -> None:
    answer = ann.message(room.decision, action="UP")
    first = ann.send(answer)
    second = ann.send(msgspec.structs.replace(answer, action="DOWN"))
    acknowledgement = decode(second.payload, Acknowledgement)
    assert (acknowledgement.code, second.ok) == ("conflict", True)
    assert "make a new id" in acknowledgement.reason
    assert ann.send(answer) == first
    (row,) = room.rows("answer")
    assert row.body is not None
    code, reason, kept = read_answer_body(row.body)
    assert (code, reason, decode(kept, Answer)) == (AnswerCode.ACCEPTED, "", answer)
    (conflict,) = room.rows("conflict")
    assert decode(conflict.body or b"", Answer).action == "DOWN"
    room.pass_time(1_000)
    assert [(said.teacher, said.action) for said in room.steps[0].said] == [("ann", "UP")]


def test_who_has_not_joined_is_denied_and_leaves_nothing_in_the_journal(room: Classroom, ann: Pupil) -> None:
    answer = ann.message(room.decision, action="UP")
    ann.send(answer)
    rows = len(room.rows())
    eve = Pupil(room, "eve")
    for sent in (
        eve.message(room.decision, action="UP"),
        eve.message(room.decision, action="UP", answer_id=answer.answer_id),
    ):
        refusal = decode(eve.send(sent).payload, Refusal)
        assert refusal == Refusal(code="denied", reason="join session s1 before you answer")
    assert decode(eve.control("pause").payload, Refusal).code == "denied"
    assert len(room.rows()) == rows


def test_an_answer_that_cannot_be_read_is_refused_and_counted_by_its_sender(
    room: Classroom, ann: Pupil
) -> None:
    keys = (
        KEYS.answer("s1", "ann"),
        KEYS.join("s1", "eve"),
        KEYS.control("s1", "ann"),
        KEYS.learner("create"),
        KEYS.learner("show"),
    )
    for key in keys:
        for payload in (b"", b"\xc1", b"\x00" * 40, b"\x81" * 200, encode(Done(ok=True)), b"x" * 70_000):
            assert room.refused(key, payload).code == "malformed", key
    assert room.report().malformed == {"ann": 12, "eve": 6}
    assert ann.label(room.decision, "UP").code == "accepted"


def test_an_action_that_the_session_does_not_have_is_invalid(room: Classroom, ann: Pupil) -> None:
    jump = ann.message(room.decision, action="JUMP")
    silent = ann.message(room.decision)
    assert room.refused(KEYS.answer("s1", "ann"), jump) == Refusal(
        code="invalid", reason="action 'JUMP' is not of this session: use one of LEFT, RIGHT, UP, DOWN"
    )
    assert room.refused(KEYS.answer("s1", "ann"), silent).code == "invalid"
    assert room.rows("answer") == []


@pytest.mark.parametrize("posterior", [{"UP": 0.7}, {"UP": 0.7, "DOWN": 0.7}, {}])
def test_a_posterior_that_does_not_add_up_is_refused_and_not_kept(
    room: Classroom, ann: Pupil, posterior: dict[str, float]
) -> None:
    refusal = room.refused(
        KEYS.answer("s1", "ann"), ann.message(room.decision, action="UP", posterior=posterior)
    )
    total = sum(posterior.values())
    assert refusal.code == "invalid"
    assert refusal.reason == (
        f"a posterior's probabilities add up to {total:g}: divide each by that, or leave it out"
    )
    assert room.rows("answer") == []
    sound = ann.message(room.decision, action="UP", posterior={"UP": 0.7, "DOWN": 0.3})
    assert decode(ann.send(sound).payload, Acknowledgement).code == "accepted"


def test_a_key_that_names_another_than_the_message_is_denied(room: Classroom, ann: Pupil) -> None:
    bob = Pupil(room, "bob")
    bob.join()
    answer = ann.message(room.decision, action="UP")
    for key in (KEYS.answer("s1", "bob"), KEYS.answer("s2", "ann")):
        assert room.refused(key, answer).code == "denied"
    assert room.refused(KEYS.join("s1", "bob"), Join(session="s1", teacher="ann")).code == "denied"
    control = Control(session="s1", teacher="ann", verb="pause")
    assert room.refused(KEYS.control("s1", "bob"), control).code == "denied"
    assert room.rows("answer") == []


def test_an_unknown_session_is_refused_as_such(room: Classroom) -> None:
    assert room.refused(KEYS.join("s9", "ann"), Join(session="s9", teacher="ann")).code == "unknown-session"


def test_no_token_reaches_the_journal(room: Classroom, ann: Pupil) -> None:
    canary = secrets.token_hex(16)
    bob = Pupil(room, "bob")
    bob.join(token=canary)
    answer = bob.message(room.decision, action="UP", token=canary)
    first = bob.send(answer)
    assert bob.send(answer) == first
    bob.send(msgspec.structs.replace(answer, action="DOWN"))
    pause = Control(session="s1", teacher="bob", verb="pause", token=canary)
    room.ask(bob.bus, KEYS.control("s1", "bob"), pause)
    room.pass_time(1_000)
    files = [path for path in room.data_dir.rglob("*") if path.is_file()]
    contents = b"".join(path.read_bytes() for path in files)
    assert answer.answer_id in contents
    assert canary.encode() not in contents


def test_an_answer_after_the_close_is_told_superseded_or_late_and_kept_but_not_applied(
    room: Classroom,
) -> None:
    room.create(session(window=EARLY))
    ann, bob = Pupil(room, "ann"), Pupil(room, "bob")
    ann.join()
    decision = room.decision
    assert ann.label(decision, "UP").code == "accepted"
    bob.join()
    assert bob.label(decision, "DOWN").code == "superseded"
    room.pass_time(1_001)
    assert ann.label(decision, "DOWN").code == "late"
    codes = [read_answer_body(row.body or b"")[0].value for row in room.rows("answer")]
    assert codes == ["accepted", "superseded", "late"]
    assert [(said.teacher, said.action) for said in room.steps[0].said] == [("ann", "UP")]
    assert all(step.said == () for step in room.steps[1:])


def test_who_comes_back_after_the_end_is_told_what_became_of_the_answer(room: Classroom, ann: Pupil) -> None:
    decision = room.decision
    ann.withdraw()
    room.settle()
    assert room.operate("stop").ok
    assert ann.label(decision, "UP").code == "superseded"
    assert [read_answer_body(row.body or b"")[0].value for row in room.rows("answer")] == ["superseded"]
    stranger = Pupil(room, "eve")
    assert decode(stranger.send(stranger.message(decision, action="UP")).payload, Refusal).code == "denied"


def test_a_teacher_pauses_resumes_and_changes_the_window_and_it_is_journaled(
    room: Classroom, ann: Pupil
) -> None:
    wide = WindowSpec(mode="early", span_ms=9_000, quorum=1)
    assert decode(ann.control("window", wide).payload, Done) == Done(ok=True)
    assert (room.decision.window, room.decision.remaining_ms) == (wide, 9_000)
    assert decode(ann.control("pause").payload, Done) == Done(ok=True)
    assert not decode(ann.control("pause").payload, Done).ok
    paused_at = room.decision
    room.pass_time(60_000)
    assert (room.decision.decision, paused_at.paused) == (paused_at.decision, True)
    assert decode(ann.control("resume").payload, Done) == Done(ok=True)
    assert (room.decision.paused, room.decision.remaining_ms) == (False, 9_000)
    kinds = [row.kind for row in room.rows()]
    assert [kind for kind in kinds if kind in {"window", "paused", "resumed"}] == [
        "window", "paused", "paused", "resumed",
    ]  # fmt: skip
    assert room.refused(
        KEYS.control("s1", "ann"), Control(session="s1", teacher="ann", verb="window")
    ).code == "invalid"  # fmt: skip


def test_only_the_operator_stops_a_session_and_nobody_can_join_under_that_name(
    room: Classroom, ann: Pupil
) -> None:
    assert decode(ann.control("stop").payload, Refusal).code == "denied"
    assert room.refused(KEYS.join("s1", "operator"), Join(session="s1", teacher="operator")).code == "denied"
    assert room.operate("stop") == Done(ok=True)
    assert room.report().summary.phase == "finished"
    assert not room.operate("stop").ok


def test_a_second_teacher_may_come_late_leave_and_return_and_holds_up_nobody(room: Classroom) -> None:
    room.create()
    ann, bob = Pupil(room, "ann"), Pupil(room, "bob")
    ann.join()
    ann.label(room.decision, "UP")
    assert bob.join().decision.decision == 1
    decision = room.decision
    ann.label(decision, "UP")
    assert (room.decision.decision, room.present()) == (1, ("ann", "bob"))
    bob.withdraw()
    room.settle()
    assert (room.decision.decision, room.present()) == (2, ("ann",))
    bob.withdraw = bob.bus.announce(KEYS.present("s1", "bob"))
    room.settle()
    assert room.present() == ("ann", "bob")
    bob.bus.set_online(online=False)
    room.settle()
    assert room.present() == ("ann",)
    assert [row.kind for row in room.rows() if row.kind in {"joined", "left"}] == [
        "joined", "joined", "left", "joined", "left",
    ]  # fmt: skip


def test_a_teacher_whose_token_does_not_come_back_after_a_restart_is_let_go(room: Classroom) -> None:
    room.create()
    ann, bob = Pupil(room, "ann"), Pupil(room, "bob")
    ann.join()
    bob.join()
    room.kill_learner()
    bob.bus.close()
    room.start_learner()
    assert room.present() == ("ann", "bob")
    room.pass_time(5_000)
    assert room.present() == ("ann",)
    ann.label(room.decision, "UP")
    assert room.decision.decision == 1


def test_a_presence_under_an_impossible_name_ends_nothing(room: Classroom, ann: Pupil) -> None:
    room.watcher.announce("sfid/v1/local/session/S1/present/ann")
    room.watcher.announce("sfid/v1/local/session/s1/present/Eve!")
    room.settle()
    assert ann.label(room.decision, "UP").code == "accepted"


class FailingShard(Shard):
    """A shard whose disk is full when a test says so."""

    full = False
    refused = 0

    def commit(self) -> None:
        if self.full:
            self.refused += 1
            raise JournalFull("the disk is full: free some")
        super().commit()


@pytest.fixture
def full_room(tmp_path: Path) -> Iterator[Classroom]:
    made = Classroom(tmp_path / "data", open_shard=FailingShard.open)
    made.create(session(window=EARLY))
    yield made
    assert isinstance(made.shard, FailingShard)
    made.shard.full = False
    made.shard.close()


def test_while_the_journal_is_full_nothing_is_acknowledged_and_afterwards_nothing_is_lost(
    full_room: Classroom,
) -> None:
    room, shard = full_room, full_room.shard
    assert isinstance(shard, FailingShard)
    ann, bob = Pupil(room, "ann"), Pupil(room, "bob")
    ann.join()
    shard.full = True
    answer = ann.message(room.decision, action="UP")
    refusal = decode(ann.send(answer).payload, Refusal)
    assert refusal == Refusal(code="not-durable", reason="not saved: the disk is full: free some")
    again = decode(ann.send(answer).payload, Refusal)
    assert again.code == "not-durable"
    join = Join(session="s1", teacher="bob")
    assert room.refused(KEYS.join("s1", "bob"), join).code == "not-durable"
    executed = room.requests
    before = shard.refused
    for _ in range(200):
        room.pass_time(100)
    assert (room.learner.sessions["s1"].session.decision, room.requests) == (0, executed)
    assert shard.refused - before <= 40, "the journal is tried twice a second, not at every turn"
    shard.full = False
    room.pass_time(500)
    acknowledgement = decode(ann.send(answer).payload, Acknowledgement)
    assert acknowledgement.code == "accepted"
    assert room.decision.decision == 1
    assert [(said.teacher, said.action) for said in room.steps[0].said] == [("ann", "UP")]
    bob.join()
    assert len(room.rows("answer")) == 1


def test_a_learner_whose_journal_is_full_says_so_when_it_is_asked_how_it_does(full_room: Classroom) -> None:
    room, shard = full_room, full_room.shard
    assert isinstance(shard, FailingShard)
    ann = Pupil(room, "ann")
    ann.join()
    assert (status(room).ready, status(room).reason) == (True, "")
    shard.full = True
    ann.send(ann.message(room.decision, action="UP"))
    told = status(room)
    assert (told.ready, told.reason) == (False, "nothing can be saved: the disk is full: free some")
    shard.full = False
    room.pass_time(500)
    assert (status(room).ready, status(room).reason) == (True, "")


class RecordingShard(Shard):
    """A shard that notes when a commit has ended."""

    def commit(self) -> None:
        super().commit()
        log.append("committed")


log: list[str] = []


def test_an_acknowledgement_leaves_after_the_commit_that_holds_its_answer(tmp_path: Path) -> None:
    room = Classroom(tmp_path / "data", open_shard=RecordingShard.open)
    room.create(session(window=WindowSpec(mode="full", span_ms=1_000)))
    ann = Pupil(room, "ann")
    ann.join()
    answers = [ann.message(room.decision, action="UP") for _ in range(3)]
    log.clear()
    for answer in answers:
        ann.bus.ask(KEYS.answer("s1", "ann"), encode(answer), lambda _reply: log.append("told"), 1_000)
    syncs = room.shard.syncs
    room.settle()
    assert log[:4] == ["committed", "told", "told", "told"]
    assert room.shard.syncs == syncs + 2
    room.shard.close()


def test_a_teacher_without_a_token_is_let_go_again_and_holds_up_nobody(room: Classroom) -> None:
    room.create(session(teachers_min=2))
    ghost, ann = Pupil(room, "ghost"), Pupil(room, "ann")
    ghost.join()
    ghost.withdraw()
    room.ask(ghost.bus, KEYS.join("s1", "ghost"), Join(session="s1", teacher="ghost"))
    ann.join()
    ann.label(room.decision, "UP")
    assert (room.decision.decision, room.present()) == (0, ("ann", "ghost"))
    room.pass_time(LearnerConfig(room.data_dir).teachers_gone_ms)
    assert (room.decision.decision, room.present()) == (1, ("ann",))


def test_a_reward_for_another_action_than_the_one_taken_is_rejected(room: Classroom) -> None:
    room.create(session(method="reward"))
    ann = Pupil(room, "ann")
    ann.join()
    decision = room.decision
    other = next(name for name in decision.actions if name != decision.action)
    wrong = ann.send(ann.message(decision, kind="reward", reward=1.0, action=other))
    told = decode(wrong.payload, Acknowledgement)
    assert (told.code, told.reason) == ("rejected", "that decision led to another action")
    right = ann.send(ann.message(decision, kind="reward", reward=1.0, action=decision.action))
    assert decode(right.payload, Acknowledgement).code == "accepted"


def test_an_answer_between_a_close_by_the_clock_and_its_step_is_replayed_as_it_was_told(
    room: Classroom,
) -> None:
    room.create(session(window=WindowSpec(mode="full", span_ms=1_000)))
    ann = Pupil(room, "ann")
    ann.join()
    decision = room.decision
    room.world_bus.set_online(online=False)
    room.pass_time(1_001)
    assert ann.label(decision, "UP").code == "late"
    room.world_bus.set_online(online=True)
    room.pass_time(1_000)
    assert room.decision.decision == 1
    (replayed,) = replay_directory(room.data_dir)
    assert replayed.matches
    assert [row.kind for row in room.rows() if row.kind in {"elapsed", "answer", "step"}][:3] == [
        "elapsed", "answer", "step",
    ]  # fmt: skip
