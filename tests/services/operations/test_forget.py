"""Forgetting a person: no byte of theirs is left, others' answers stay, and Q is what these alone taught."""

import json
import shutil
import signal
from pathlib import Path

import pytest

from protocol.codec import decode
from protocol.crowd_forget import corrected_answers
from protocol.journal import Record, read_answer_body
from protocol.messages import Answer, WindowSpec
from services.operations.forget import Forgetting, forget
from services.replay import replay_crowds, replay_directory
from services.runtime.clock import SystemClock
from services.runtime.journal import JournalLocked, Row, Shard, read_rows, verify
from sfid_core.sokoban.actions import Action
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.simulated import SimulatedTeacher
from tests.services.aggregator.crowd_room import CrowdRoom
from tests.services.cli.command_line import sfid
from tests.services.learner.classroom import Classroom, Pupil, session
from tests.services.operations.mortal import code_when_killed_at

PERSON, OTHER = "zelda-quux", "annabel-roe"


def taught(data: Path, method: str = "sfid") -> Path:
    """Return the data directory of a finished session that two taught, PERSON often wrongly."""
    room = Classroom(data)
    config = room.create(session(method=method, teachers_min=2))
    faults = {PERSON: TeacherParameters(0.4, 0.1, 0.2), OTHER: TeacherParameters()}
    pupils = {Pupil(room, name): SimulatedTeacher(config.seed, name, "s1", faults[name]) for name in faults}
    for pupil in pupils:
        pupil.join()
    room.teach(pupils, lambda: room.finished)
    room.shard.close()
    return data


def answers_of(data: Path, teacher: str) -> list[tuple[int, bytes]]:
    """Return the rows with answers of a teacher as (number, body)."""
    return [
        (row.seq, row.body)
        for row in read_rows(data)
        if row.kind == "answer" and row.body is not None and said(row).teacher == teacher
    ]


def said(row: Row) -> Answer:
    return decode(read_answer_body(row.body or b"")[2], Answer)


def payloads(data: Path, person: str) -> list[bytes]:
    return [body for _, body in answers_of(data, person)]


def holding(data: Path, *needles: bytes) -> list[str]:
    """Return the files below a directory that hold any of these bytes."""
    files = [path for path in sorted(data.rglob("*")) if path.is_file()]
    return [path.name for path in files if any(needle in path.read_bytes() for needle in needles)]


def forgotten(data: Path) -> Forgetting:
    return forget(data, PERSON, SystemClock())


def test_no_byte_of_a_forgotten_person_is_left_and_the_answers_of_others_are_untouched(
    tmp_path: Path,
) -> None:
    data = taught(tmp_path / "data")
    theirs, others = payloads(data, PERSON), answers_of(data, OTHER)
    (data / "logs").mkdir()
    (data / "logs" / "learner.log").write_text(f"teacher {PERSON} is gone\n")
    assert holding(data, PERSON.encode()) == ["learner.log", "journal.mirror", "journal.sqlite"]
    found = forgotten(data)
    assert found.answers == len(theirs) > 0
    assert holding(data, PERSON.encode(), *theirs) == []
    assert answers_of(data, OTHER) == others
    assert (data / "logs" / "learner.log").read_text() == "teacher erased is gone\n"
    (kept,) = found.sessions.values()
    assert kept.q_sha256 != kept.q_sha256_before
    (replayed,) = replay_directory(data)
    assert (replayed.matches, replayed.q_sha256, replayed.erased) == (True, kept.q_sha256, len(theirs))
    proof = verify(data)
    assert (proof.ok, proof.problems, proof.erased) == (True, (), len(theirs))


def test_a_learner_goes_on_from_a_journal_with_somebody_forgotten(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    (kept,) = forgotten(data).sessions.values()
    room = Classroom(data)
    assert room.learner.sessions["s1"].session.learner.sha256() == kept.q_sha256
    assert room.learner.sessions["s1"].session.counts.pending == 0
    room.shard.close()
    assert replay_directory(data)[0].matches


@pytest.mark.parametrize("method", ["sfid", "reward", "pies", "advise-labels"])
def test_with_every_method_a_session_without_somebody_replays(tmp_path: Path, method: str) -> None:
    data = taught(tmp_path / "data", method)
    before = replay_directory(data)[0]
    forgotten(data)
    after = replay_directory(data)[0]
    assert (after.matches, after.episodes) == (True, before.episodes)
    assert holding(data, PERSON.encode()) == []


def test_forgetting_again_changes_nothing_and_a_second_person_can_follow(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    first = forgotten(data)
    digest = replay_directory(data)[0].q_sha256
    again = forgotten(data)
    assert (again.answers, again.rows, replay_directory(data)[0].q_sha256) == (0, 0, digest)
    second = forget(data, OTHER, SystemClock())
    assert first.rows > 0
    assert second.answers > 0
    assert holding(data, PERSON.encode(), OTHER.encode()) == []
    assert replay_directory(data)[0].matches
    assert verify(data).ok


def test_a_running_learner_is_not_pulled_from_under_its_feet(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    with Shard.open(data), pytest.raises(JournalLocked, match="already writes this journal; stop it"):
        forgotten(data)
    done = sfid("forget", str(tmp_path / "nowhere"), "--person", PERSON)
    assert (done.code, done.stderr.count("\n")) == (2, 1)


def forget_person(data: Path) -> None:
    """Forget PERSON; also run by processes that are killed on the way."""
    forget(data, PERSON, SystemClock())


def test_killed_at_any_moment_it_is_completed_or_undone_at_the_next_opening(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    others, theirs = answers_of(data, OTHER), payloads(data, PERSON)
    before = replay_directory(data)[0].q_sha256
    whole = tmp_path / "whole"
    shutil.copytree(data, whole)
    forgotten(whole)
    after = replay_directory(whole)[0].q_sha256
    seen, ended_code = set(), -signal.SIGKILL
    for moment in range(1, 200):
        copy = tmp_path / f"copy-{moment}"
        shutil.copytree(data, copy)
        ended_code = code_when_killed_at(moment, forget_person, copy)
        assert ended_code in {0, -signal.SIGKILL}
        with Shard.open(copy):
            pass
        digest = replay_directory(copy)[0].q_sha256
        seen.add(digest)
        assert digest in {before, after}
        assert verify(copy).ok
        assert replay_directory(copy)[0].matches
        assert answers_of(copy, OTHER) == others
        if digest == after:
            assert holding(copy, PERSON.encode(), *theirs) == []
        shutil.rmtree(copy)
        if ended_code == 0:
            break
    assert ended_code == 0
    assert seen == {before, after}


def crowd_data(tmp_path: Path) -> Path:
    """Return a data directory in which PERSON taught in a crowd of three."""
    room = CrowdRoom(tmp_path / "data")
    room.create()
    names = (PERSON, "ann", "bob")
    members = room.members(*names)
    mix = ("UP", "UP", "LEFT", "DOWN", "RIGHT")
    for number in range(20):
        for place, member in enumerate(members):
            member.label(mix[(number * (place + 1)) % 5])
    room.close()
    shutil.move(room.crowd_dir / "crowd-crowd", room.data_dir / "crowd-crowd")
    return room.data_dir


def test_a_worker_is_forgotten_in_the_crowd_and_what_was_handed_on_is_corrected(tmp_path: Path) -> None:
    data = crowd_data(tmp_path)
    rows = [Record(row.kind, row.at_ns, row.body or b"") for row in read_rows(data / "crowd-crowd")]
    wanted = {one.before.answer_id: one.after for one in corrected_answers(rows, {PERSON})}
    assert wanted
    found = forgotten(data)
    assert found.sessions["s1"].corrected == len(wanted)
    now = {
        said(row).answer_id: said(row) for row in read_rows(data, "s1") if row.kind == "answer" and row.body
    }
    assert {key: now[key] for key, after in wanted.items() if after} == {k: v for k, v in wanted.items() if v}
    assert holding(data, PERSON.encode()) == []
    assert replay_directory(data)[0].matches
    (crowd,) = replay_crowds(data)
    assert (crowd.matches, set(crowd.reliabilities)) == (True, {"ann", "bob"})
    assert verify(data).ok
    assert verify(data / "crowd-crowd").ok
    assert forgotten(data).rows == 0


def test_the_command_tells_erases_and_leaves_a_journal_that_verifies(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    (data / "recordings").mkdir()
    recording = data / "recordings" / "s1.rrd"
    recording.write_bytes(b"RRF2")
    dry = json.loads(sfid("forget", str(data), "--person", PERSON, "--dry-run", "--json").stdout)
    assert (dry["dry_run"], recording.exists(), len(payloads(data, PERSON))) == (
        True,
        True,
        dry["people"][0]["answers"],
    )
    done = sfid("forget", str(data), "--person", PERSON, "--recordings", "--json")
    (person,) = json.loads(done.stdout)["people"]
    assert (done.code, person["answers"], recording.exists()) == (0, dry["people"][0]["answers"], False)
    replayed = sfid("replay", str(data), "--verify")
    assert (replayed.code, f"{person['answers']} answers erased" in replayed.stdout) == (0, True)
    verified = sfid("verify", str(data))
    assert (verified.code, f"{person['answers']} of them erased" in verified.stdout) == (0, True)
    assert sfid("forget", str(data), "--person", PERSON).code == 1


def test_only_one_session_is_forgotten_where_one_is_named(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    (data / "learner.log").write_text(PERSON)
    assert forget(data, PERSON, SystemClock(), "another").rows == 0
    assert (data / "learner.log").read_text() == PERSON
    found = forget(data, PERSON, SystemClock(), "s1")
    assert (found.answers > 0, holding(data, PERSON.encode())) == (True, ["learner.log"])


def test_a_step_that_was_not_taken_back_is_not_taken_back_without_somebody_either(tmp_path: Path) -> None:
    room = Classroom(tmp_path / "data")
    room.create(session(method="guidance", teachers_min=3))
    pupils = [Pupil(room, name) for name in (PERSON, OTHER, "bob")]
    for pupil in pupils:
        pupil.join()
    for number in range(120):
        decision = room.decision
        for place, pupil in enumerate(pupils):
            # Two blame and one praises, then the other way round: without one of them it comes out otherwise.
            reward = -1.0 if (number + place) % 3 == 0 else (1.0 if place == 0 else -1.0)
            if decision.asked == "guidance":
                guided = (Action((number * place) % 4).name,)
                pupil.send(pupil.message(decision, kind="guidance", guidance=guided))
            elif decision.asked == "reward":
                pupil.send(pupil.message(decision, kind="reward", reward=reward))
    room.shard.close()
    before = replay_directory(room.data_dir)[0]
    found = forgotten(room.data_dir)
    after = replay_directory(room.data_dir)[0]
    assert (before.matches, after.matches, found.answers > 50) == (True, True, True)
    assert after.erased == found.answers
    assert verify(room.data_dir).ok


def test_a_window_that_somebody_ended_is_as_long_without_them(tmp_path: Path) -> None:
    """What came after the window closed, and before its deadline, is superseded still, and not late."""
    room = Classroom(tmp_path / "data")
    room.create(session(window=WindowSpec(mode="until-answered", span_ms=100, quorum=1), teachers_min=3))
    pupils = [Pupil(room, name) for name in (PERSON, OTHER, "bob")]
    for pupil in pupils:
        pupil.join()
    room.pass_time(500)
    pupils[0].control("window", WindowSpec(mode="early", span_ms=100, quorum=1))
    decision = room.decision
    codes = [pupil.label(decision, "UP").code for pupil in pupils[1:]]
    assert codes == ["accepted", "superseded"]
    room.shard.close()
    forgotten(room.data_dir)
    assert holding(room.data_dir, PERSON.encode()) == []
    assert replay_directory(room.data_dir)[0].matches
