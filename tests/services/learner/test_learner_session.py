"""Whole sessions: taught to their end, interrupted in every way, and always the same table."""

from collections.abc import Mapping
from typing import Any

import msgspec
import pytest

from protocol.codec import PAYLOAD_MAX, decode
from protocol.messages import CreateSession, LabelTotals, Refusal, SessionList, SessionQuery, WindowSpec, Wire
from protocol.translate import config_of, episode_message, label_totals
from protocol.world_messages import Begun, Executed
from services.replay import Replayed, replay_directory
from services.runtime.journal import verify
from sfid_core.experiments.batch import BatchResult, run_batch
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.simulated import SimulatedTeacher
from tests.services.learner.classroom import KEYS, UNTIL_ANSWERED, Classroom, Pupil, session

FAULTS = {"ann": TeacherParameters(0.1, 0.1, 0.2), "bob": TeacherParameters()}


def minds(config: CreateSession, *names: str) -> dict[str, SimulatedTeacher]:
    return {name: SimulatedTeacher(config.seed, name, config.session, FAULTS[name]) for name in names}


def batch(config: CreateSession, *names: str) -> BatchResult:
    return run_batch(config_of(config), {name: FAULTS[name] for name in names})


def seated(room: Classroom, config: CreateSession, *names: str) -> dict[Pupil, SimulatedTeacher]:
    pupils = {Pupil(room, name): mind for name, mind in minds(config, *names).items()}
    for pupil in pupils:
        pupil.join()
    return pupils


def measures(room: Classroom) -> list[dict[str, Any]]:
    """What the learner reports of each episode, without the times and names that only a live session has."""
    return [comparable(message) for message in room.report().episodes]


def comparable(message: Wire) -> dict[str, Any]:
    live_only = {"epoch", "decision", "at_ns", "session"}
    return {
        field: value for field, value in msgspec.structs.asdict(message).items() if field not in live_only
    }


def batch_measures(room: Classroom, result: BatchResult) -> list[dict[str, Any]]:
    live = room.learner.sessions["s1"].session
    return [comparable(episode_message(episode, live, 0)) for episode in result.episodes]


@pytest.mark.parametrize("method", ["sfid", "reward"])
def test_a_live_session_of_two_teachers_learns_what_the_plain_loop_learns(
    room: Classroom, method: str
) -> None:
    config = room.create(session(method=method, teachers_min=2))
    room.teach(seated(room, config, "ann", "bob"), lambda: room.finished)
    result, report = batch(config, "ann", "bob"), room.report()
    assert report.q_sha256 == result.q_sha256
    assert measures(room) == batch_measures(room, result)
    assert report.labels == label_totals(result.counts)
    assert [(step.decision, step.episode) for step in room.steps] == [
        (number, episode.episode)
        for number, episode in enumerate(episode for episode in result.episodes for _ in range(episode.steps))
    ]
    assert [message.episode for message in room.episodes] == [0, 1]
    room.pass_time(500)
    assert replay_directory(room.data_dir) == [
        Replayed("s1", result.q_sha256, matches=True, digests=3, events=replayed_events(room), episodes=2)
    ]


def replayed_events(room: Classroom) -> int:
    elapsed = sum(decode_elapsed(row.body or b"") is not None for row in room.rows("step"))
    return len(room.rows()) - len(room.rows("created")) - len(room.rows("digest")) + elapsed


def decode_elapsed(body: bytes) -> int | None:
    value: int | None = msgspec.msgpack.decode(body)[5]
    return value


def test_plain_q_learning_runs_by_itself_to_the_table_of_the_plain_loop(room: Classroom) -> None:
    config = room.create(session(method="q-learning", teachers_min=0))
    result, report = batch(config), room.report()
    assert (report.summary.phase, report.q_sha256) == ("finished", result.q_sha256)
    assert measures(room) == batch_measures(room, result)


@pytest.mark.parametrize(
    "between, closed",
    [
        (WindowSpec(mode="until-answered", span_ms=100), (0, 0, 1)),
        (WindowSpec(mode="early", span_ms=1_000), (1, 1, 2)),
    ],
    ids=["without end, so it has its whole span again", "longer, so it was over"],
)
def test_a_window_that_was_changed_and_is_as_it_was_runs_out(
    room: Classroom, between: WindowSpec, closed: tuple[int, ...]
) -> None:
    early = WindowSpec(mode="early", span_ms=100)
    room.create(session(window=early))
    ann = Pupil(room, "ann")
    ann.join()
    decision = room.decision.decision
    ann.control("window", between)
    room.pass_time(150)
    assert room.decision.decision == decision
    ann.control("window", early)
    for milliseconds, count in zip((0, 99, 1), closed, strict=True):
        room.pass_time(milliseconds)
        assert room.decision.decision == decision + count


def conserved(labels: LabelTotals) -> bool:
    parts = (labels.applied, labels.superseded, labels.late, labels.rejected, labels.pending)
    return labels.submitted == sum(parts)


def test_every_answer_is_accounted_for_at_every_moment(room: Classroom) -> None:
    """Two teachers with a quorum of both, one of whom changes their mind, and lags behind at times."""
    room.create(session(window=WindowSpec(mode="early", span_ms=100, quorum=2), episodes=1))
    ann, bob = Pupil(room, "ann"), Pupil(room, "bob")
    ann.join()
    bob.join()
    seen: list[LabelTotals] = []
    codes: list[str] = []
    for turn in range(12):
        decision = room.decision
        codes.append(ann.label(decision, "UP").code)
        codes.append(ann.label(decision, "RIGHT").code)
        seen.append(room.report().labels)
        if turn % 3 == 0:
            room.pass_time(100)
            codes.append(bob.label(decision, "RIGHT").code)
        elif turn % 3 == 1:
            codes.append(bob.label(decision, "RIGHT").code)
            codes.append(bob.label(decision, "LEFT").code)
        else:
            room.pass_time(150)
            codes.append(bob.label(decision, "LEFT").code)
        room.pass_time(100)
        seen.append(room.report().labels)
    assert all(map(conserved, seen))
    assert [labels.pending for labels in seen] == [1, 0] * 12
    last = room.report().labels
    assert (last.submitted, last.acknowledged, last.rejected) == (len(codes), len(codes), 0)
    assert (last.late, last.superseded) == (codes.count("late"), 12 + codes.count("superseded"))
    assert {"accepted", "superseded", "late"} == set(codes)


def test_a_learner_killed_at_any_decision_goes_on_there_and_ends_with_the_same_table(room: Classroom) -> None:
    config = room.create(session(episodes=3))
    pupils = seated(room, config, "ann")
    result = batch(config, "ann")
    for stop_at in (0, 1, 2, 17, 40):
        room.teach(pupils, lambda: room.decision.decision >= stop_at)  # noqa: B023 - used up at once
        before = room.decision
        room.kill_learner()
        room.start_learner()
        after = room.decision
        assert (after.decision, after.episode, after.step, after.state, after.action) == (
            before.decision, before.episode, before.step, before.state, before.action,
        )  # fmt: skip
        assert after.epoch == before.epoch + 1
        assert after.teachers == ("ann",)
    room.teach(pupils, lambda: room.finished)
    assert (room.report().q_sha256, measures(room)) == (result.q_sha256, batch_measures(room, result))
    assert sorted({step.decision for step in room.steps}) == list(
        range(len({s.decision for s in room.steps}))
    )
    assert verify(room.data_dir).ok


def test_whoever_left_before_the_learner_died_comes_back_by_presence_alone(room: Classroom) -> None:
    room.create()
    ann, bob = Pupil(room, "ann"), Pupil(room, "bob")
    ann.join()
    bob.join()
    ann.withdraw()
    room.settle()
    room.pass_time(1_000)  # nobody waits for that row: it is durable after a while
    room.kill_learner()
    room.start_learner()
    assert room.present() == ("bob",)
    for name in ("ann", "eve"):  # eve never joined: whoever only announces themselves is let in nowhere
        room.watcher.announce(KEYS.present("s1", name))
    room.settle()
    assert room.present() == ("ann", "bob")


def test_steps_that_were_not_committed_when_the_learner_died_come_again_with_the_same_bits(
    room: Classroom,
) -> None:
    """Without a teacher nothing forces a commit: all of them are lost, and all of them come again."""
    room.create(session(window=WindowSpec(mode="early", span_ms=10), teachers_min=0, episodes=20))
    while room.decision.decision < 30:
        room.pass_time(10)
    first = {step.decision: step for step in room.steps}
    room.kill_learner()
    room.steps.clear()
    room.start_learner()
    restarted_at = room.decision.decision
    assert restarted_at < 30
    while room.decision.decision < 30:
        room.pass_time(10)
    repeated = {step.decision: step for step in room.steps}
    assert sorted(repeated) == list(range(restarted_at, 30))
    for number, step in repeated.items():
        assert msgspec.structs.replace(step, epoch=1, at_ns=0) == msgspec.structs.replace(
            first[number], epoch=1, at_ns=0
        )


def test_an_environment_without_memory_is_restored_in_the_middle_of_an_episode(room: Classroom) -> None:
    config = room.create(session(episodes=3))
    pupils = seated(room, config, "ann")
    for stop_at in (1, 9, 30):
        room.teach(pupils, lambda: room.decision.decision >= stop_at)  # noqa: B023 - used up at once
        room.replace_environment()
    room.teach(pupils, lambda: room.finished)
    result = batch(config, "ann")
    assert (room.report().q_sha256, measures(room)) == (result.q_sha256, batch_measures(room, result))


def test_both_may_die_together(room: Classroom) -> None:
    config = room.create(session())
    pupils = seated(room, config, "ann")
    room.teach(pupils, lambda: room.decision.decision >= 20)
    room.kill_learner()
    room.replace_environment()
    room.start_learner()
    room.teach(pupils, lambda: room.finished)
    assert room.report().q_sha256 == batch(config, "ann").q_sha256


def nonsense(reply: Wire) -> Mapping[str, Wire | bytes]:
    """Every wrong reply to a begin or an execute, by what is wrong with it."""
    wrong: dict[str, Wire | bytes] = {
        "no message": b"\xc1",
        "another message": Refusal(code="busy", reason="later"),
        "the wrong kind of message": msgspec.msgpack.encode({"type": "done", "schema": 1, "ok": True}),
    }
    if isinstance(reply, Begun):
        wrong["another episode"] = msgspec.structs.replace(reply, episode=reply.episode + 1)
        wrong["another step"] = msgspec.structs.replace(reply, step=reply.step + 1)
        wrong["other actions"] = msgspec.structs.replace(reply, actions=("JUMP",))
    elif isinstance(reply, Executed):
        wrong["another decision"] = msgspec.structs.replace(reply, decision=reply.decision + 1)
    return wrong


@pytest.mark.parametrize(
    "fault",
    ["no message", "another message", "the wrong kind of message", "another episode", "another step",
     "other actions", "another decision"],
)  # fmt: skip
def test_an_environment_that_answers_nonsense_is_asked_again_until_it_answers(
    room: Classroom, fault: str
) -> None:
    told: list[str] = []

    def twice(verb: str, reply: Wire) -> Wire | bytes:
        wrong = nonsense(reply).get(fault)
        if wrong is None or told.count(verb) == 2:
            return reply
        told.append(verb)
        return wrong

    room.tamper = twice
    config = room.create(session(episodes=1))
    pupils = seated(room, config, "ann")
    for _ in range(3):
        room.teach_once(pupils)
        room.pass_time(100)
        room.pass_time(100)
    assert len(told) >= 2
    room.teach(pupils, lambda: room.finished)
    assert room.report().q_sha256 == batch(config, "ann").q_sha256


def test_an_environment_that_is_silent_is_asked_again_and_nothing_is_lost(room: Classroom) -> None:
    config = room.create(session(episodes=1))
    pupils = seated(room, config, "ann")
    room.teach(pupils, lambda: room.decision.decision == 3)
    room.world_bus.set_online(online=False)
    (ann,) = pupils
    ann.send(room.opinion(ann, pupils[ann], room.decision))
    for _ in range(5):
        room.pass_time(600)
    assert room.report().summary.decision == 3
    room.world_bus.set_online(online=True)
    room.pass_time(600)
    room.teach(pupils, lambda: room.finished)
    assert room.report().q_sha256 == batch(config, "ann").q_sha256


def test_a_level_that_the_environment_refuses_stops_the_session_and_says_why(room: Classroom) -> None:
    config = session(teachers_min=0)
    world = msgspec.structs.replace(config.world, level="####\n#@ #\n####")
    room.create(msgspec.structs.replace(config, world=world))
    report = room.report()
    assert (report.summary.phase, report.failure) == (
        "finished",
        "level 0, lines 1-3: no box; put a $ (or * on a goal) on the floor",
    )
    assert [row.kind for row in room.rows()][-2:] == ["stopped", "digest"]


def test_a_restored_environment_that_stands_elsewhere_stops_the_session(room: Classroom) -> None:
    """Another version of the rules would teach the agent about another world: better to stop."""
    config = room.create(session())
    pupils = seated(room, config, "ann")
    room.teach(pupils, lambda: room.decision.decision == 5)

    def elsewhere(_verb: str, reply: Wire) -> Wire:
        return msgspec.structs.replace(reply, state=bytes(16)) if isinstance(reply, Begun) else reply

    room.replace_environment()
    room.tamper = elsewhere
    (ann,) = pupils
    ann.label(room.decision, "UP")
    assert room.report().failure == (
        "the restored environment stands in another state: its version or level differs"
    )
    assert room.finished


def test_a_session_of_the_same_content_is_the_same_and_of_another_a_conflict(room: Classroom) -> None:
    config = room.create()
    room.create()
    other = msgspec.structs.replace(config, seed=8)
    assert room.refused(KEYS.learner("create"), other).code == "conflict"
    assert len(room.rows("created")) == 1
    assert room.report().config == config


def test_a_session_with_a_value_that_makes_no_sense_is_refused_by_name(room: Classroom) -> None:
    refusal = room.refused(KEYS.learner("create"), session(parameters={"alpha": 1.5}))
    assert refusal == Refusal(
        code="invalid",
        reason="alpha 1.5 is outside (0, 1]: the default is 0.1 (Raza, Johnston & Williams 2016)",
    )
    assert room.refused(KEYS.learner("create"), session(method="sorcery")).code == "invalid"
    assert room.rows() == []


def test_a_report_comes_in_pages_of_a_hundred_episodes(room: Classroom) -> None:
    room.create(session(method="q-learning", teachers_min=0, episodes=130, window=UNTIL_ANSWERED))
    first = room.report()
    query = msgspec.msgpack.encode(
        {"type": "session-query", "schema": 1, "session": "s1", "first_episode": 100}
    )
    reply = room.ask(room.watcher, KEYS.learner("show"), query)
    second = decode(reply.payload, type(first))
    numbers = [episode.episode for episode in (*first.episodes, *second.episodes)]
    assert (len(first.episodes), second.first_episode, numbers) == (100, 100, list(range(130)))


def test_a_thousand_sessions_are_listed_in_pages_each_once_the_latest_first(room: Classroom) -> None:
    names = [f"session-{number}" for number in range(1_000)]
    for name in names:
        room.create(session(session=name))
    pages: list[list[str]] = []
    leave_out: int | None = 0
    while leave_out is not None:
        reply = room.ask(room.watcher, KEYS.learner("list"), SessionQuery(leave_out=leave_out))
        listed = decode(reply.payload, SessionList)
        assert len(reply.payload) <= PAYLOAD_MAX
        pages.insert(0, [summary.session for summary in listed.sessions])
        leave_out = listed.older
    assert [name for page in pages for name in page] == names
    assert [len(page) > 200 for page in pages[1:]] == [True] * (len(pages) - 1)
    assert len(pages) > 1
    latest = room.ask(room.watcher, KEYS.learner("list"), b"")
    assert [summary.session for summary in decode(latest.payload, SessionList).sessions] == pages[-1]


def test_a_question_for_the_list_that_cannot_be_read_is_refused(room: Classroom) -> None:
    for wrong in (
        b"nonsense",
        msgspec.msgpack.encode({"type": "session-query", "schema": 1, "leave_out": -1}),
    ):
        assert room.refused(KEYS.learner("list"), wrong).code == "malformed"
