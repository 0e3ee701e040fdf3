"""Several learners of one data directory on one bus: who answers for which session."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from protocol.codec import decode, encode
from protocol.messages import (
    Acknowledgement,
    Answer,
    Branch,
    Control,
    Decision,
    Done,
    Join,
    JournalRows,
    Refusal,
    RowsQuery,
    SessionQuery,
    SessionReport,
    Welcome,
    World,
)
from protocol.session_union import union, untold
from services.learner.config import LearnerConfig
from services.learner.ownership import agree_on_shards, shard_of
from services.learner.service import Learner
from services.operator import Operator
from services.runtime.bus import Reply
from services.runtime.journal import JournalFenced, Shard, read_rows, shard_directory, verify
from services.runtime.memory_bus import MemoryBus
from sfid_core.session.events import TeacherLeft
from tests.services.learner.classroom import KEYS, ROOM, Classroom, session

SHARDS = 3
NAMES = ("s1", "s2", "s4", "lesson", "a", "b")


class School(Classroom):
    """Learners of three shards: two of them in one process, on one bus."""

    def start_learner(self) -> None:
        self.both, self.alone = MemoryBus(self.hub), MemoryBus(self.hub)
        self.learners: dict[int, Learner] = {}
        self.teacher = MemoryBus(self.hub)
        agree_on_shards(self.data_dir, SHARDS)
        for shard in range(SHARDS):
            self.start_shard(shard, self.alone if shard == SHARDS - 1 else self.both)

    def start_shard(self, shard: int, bus: MemoryBus) -> Learner:
        config = LearnerConfig(self.data_dir, shard=shard, shards=SHARDS)
        learner = Learner(config, bus, Shard.open(self.data_dir, shard), self.clock)
        self.learners[shard] = learner
        learner.open()
        self.settle()
        return learner

    def stop_shard(self, shard: int) -> None:
        learner = self.learners.pop(shard)
        learner.doors.close()
        learner.shard.close()
        self.settle()

    def settle(self) -> None:
        while self.hub.deliver_all() or self._turned():
            pass

    def _turned(self) -> bool:
        for learner in tuple(self.learners.values()):
            learner.loop.turn(0.0)
        return self.hub.deliver_all() > 0

    def asked(self, key: str, message: Any, bus: MemoryBus | None = None) -> Reply | None:  # noqa: ANN401
        """Ask, and return what came once everybody has ended, if anything did."""
        replies: list[Reply | None] = []
        (bus or self.watcher).ask(key, encode(message), replies.append, 60_000)
        self.settle()
        assert len(replies) == 1
        return replies[0]

    def create_named(self, name: str) -> None:
        reply = self.asked(KEYS.learner("create"), session(session=name))
        assert reply is not None
        assert decode(reply.payload, Done) == Done(ok=True)

    def create_wide(self, name: str) -> None:
        """Create a session whose line in the list is long."""
        reply = self.asked(KEYS.learner("create"), session(session=name, world=WIDE))
        assert reply is not None
        assert reply.ok

    def join(self, name: str) -> Welcome:
        self.teacher.announce(KEYS.present(name, "ann"))
        reply = self.asked(KEYS.join(name, "ann"), Join(session=name, teacher="ann"), self.teacher)
        assert reply is not None
        return decode(reply.payload, Welcome)

    def label(self, name: str, decision: Decision, number: int = 1) -> Acknowledgement | None:
        answer = Answer(
            answer_id=number.to_bytes(16, "big"), session=name, teacher="ann", epoch=decision.epoch,
            decision=decision.decision, episode=decision.episode, step=decision.step, state=decision.state,
            kind="label", action="LEFT",
        )  # fmt: skip
        reply = self.asked(KEYS.answer(name, "ann"), answer, self.teacher)
        return None if reply is None else decode(reply.payload, Acknowledgement)

    def latest(self, name: str) -> Decision:
        return next(decision for decision in reversed(self.decisions) if decision.session == name)

    def asked_status(self, learner: Learner) -> bytes:
        """Return what a learner says of itself."""
        reply = self.asked(learner.standing.key, SessionQuery())
        assert reply is not None
        return reply.payload

    def listed(self) -> list[str]:
        heard: list[tuple[Reply, ...]] = []
        self.watcher.ask_all(KEYS.learner("list"), encode(SessionQuery()), heard.append, 60_000)
        self.settle()
        assert len(heard) == 1
        return [one.session for one in union(reply.payload for reply in heard[0]).sessions]


@pytest.fixture
def school(tmp_path: Path) -> School:
    return School(tmp_path / "data")


@pytest.fixture
def full(school: School) -> School:
    for name in NAMES:
        school.create_named(name)
    return school


def test_a_session_is_created_in_its_shard_alone_whoever_hears_of_it(full: School) -> None:
    held = {shard: set(learner.sessions) for shard, learner in full.learners.items()}
    assert held == {
        shard: {name for name in NAMES if shard_of(name, SHARDS) == shard} for shard in range(SHARDS)
    }
    assert all(held.values())
    full.create_named("s1")
    assert sum("s1" in learner.sessions for learner in full.learners.values()) == 1


def test_a_teacher_joins_and_answers_each_session_where_it_is(full: School) -> None:
    for name in NAMES:
        full.join(name)
        told = full.label(name, full.latest(name))
        assert told is not None
        assert (told.code, full.latest(name).decision) == ("accepted", 1)
    for shard, learner in full.learners.items():
        answered = sorted(row.session for row in learner.shard.rows() if row.kind == "answer")
        assert answered == sorted(name for name in NAMES if shard_of(name, SHARDS) == shard)


def test_reports_rows_and_control_come_from_the_owner(full: School) -> None:
    for name in NAMES:
        shown = full.asked(KEYS.learner("show"), SessionQuery(session=name))
        rows = full.asked(KEYS.learner("rows"), RowsQuery(session=name))
        control = Control(session=name, teacher="operator", verb="pause")
        paused = full.asked(KEYS.control(name, "operator"), control)
        assert shown is not None
        assert rows is not None
        assert paused is not None
        assert decode(shown.payload, SessionReport).summary.session == name
        assert decode(rows.payload, JournalRows).session == name
        assert decode(paused.payload, Done) == Done(ok=True)


@pytest.mark.parametrize("name", ["nobody", "nowhere", "nothing", "never"])
def test_of_a_session_that_is_nowhere_its_owner_says_so(full: School, name: str) -> None:
    asked = [
        full.asked(KEYS.learner("show"), SessionQuery(session=name)),
        full.asked(KEYS.learner("rows"), RowsQuery(session=name)),
        full.asked(KEYS.learner("branch"), Branch(session=name, episode=0, branch=f"{name}-from0")),
        full.asked(KEYS.join(name, "ann"), Join(session=name, teacher="ann")),
        full.asked(KEYS.control(name, "operator"), Control(session=name, teacher="operator", verb="pause")),
    ]
    for reply in asked:
        assert reply is not None
        refusal = decode(reply.payload, Refusal)
        assert (reply.ok, refusal.code) == (False, "unknown-session")
        assert refusal.reason == f"no session {name} here: `sfid session list` shows what there is"


def test_the_list_is_the_union_of_all_learners(full: School) -> None:
    assert sorted(full.listed()) == sorted(NAMES)
    full.stop_shard(2)
    assert sorted(full.listed()) == sorted(name for name in NAMES if shard_of(name, SHARDS) != 2)


def test_a_shard_without_a_learner_gives_no_answer_and_the_others_go_on(full: School) -> None:
    full.join("s2")
    full.join("s1")
    decision = full.latest("s2")
    full.stop_shard(1)
    assert shard_of("s2", SHARDS) == 1
    assert full.label("s2", decision) is None
    assert full.asked(KEYS.learner("show"), SessionQuery(session="s2")) is None
    assert full.asked(KEYS.join("s2", "bob"), Join(session="s2", teacher="bob")) is None
    assert full.label("s1", full.latest("s1")) is not None


def test_sessions_go_on_in_another_process_and_know_who_is_there(full: School) -> None:
    full.join("s2")
    assert full.label("s2", full.latest("s2"), 1) is not None
    before = full.latest("s2")
    full.stop_shard(1)
    taken = full.start_shard(1, full.alone)
    after = full.latest("s2")
    assert (after.epoch, after.decision, after.teachers) == (before.epoch + 1, before.decision, ("ann",))
    full.pass_time(taken.config.teachers_gone_ms + 1)
    assert full.latest("s2").teachers == ("ann",)
    again, new = full.label("s2", before, 1), full.label("s2", full.latest("s2"), 2)
    assert again is not None
    assert again.code == "conflict"  # another content under the first id: the journal has come along
    assert new is not None
    assert new.code == "accepted"
    answers = [row.unique for row in read_rows(full.data_dir, "s2") if row.kind == "answer"]
    assert answers == [(1).to_bytes(16, "big"), (2).to_bytes(16, "big")]


def test_a_branch_lies_beside_its_origin_and_another_name_is_refused_with_one_that_does(
    full: School,
) -> None:
    full.join("lesson")
    lesson = shard_of("lesson", SHARDS)
    elsewhere = next(f"x{number}" for number in range(99) if shard_of(f"x{number}", SHARDS) != lesson)
    refused = full.asked(KEYS.learner("branch"), Branch(session="lesson", episode=0, branch=elsewhere))
    assert refused is not None
    refusal = decode(refused.payload, Refusal)
    assert (refusal.code, refusal.reason) == (
        "invalid",
        "of several learners one has lesson and its branches: begin the branch's name with lesson-from",
    )
    done = full.asked(KEYS.learner("branch"), Branch(session="lesson", episode=0, branch="lesson-from0"))
    assert done is not None
    assert decode(done.payload, Done) == Done(ok=True)
    assert "lesson-from0" in full.learners[lesson].sessions
    taken = full.asked(KEYS.learner("create"), session(session="lesson-from0", episodes=9))
    assert taken is not None
    assert decode(taken.payload, Refusal).code == "conflict"
    assert "lesson-from0" in full.listed()


def test_an_old_owner_that_wakes_up_is_fenced_before_it_says_anything(full: School) -> None:
    name = next(name for name in NAMES if shard_of(name, SHARDS) == 2)
    full.join(name)
    full.alone.set_online(online=False)
    old = full.learners.pop(2)
    (shard_directory(full.data_dir, 2) / "lock").unlink()
    new = full.start_shard(2, full.both)
    told = full.label(name, full.latest(name), 1)
    assert told is not None
    assert told.epoch == new.shard.epoch == old.shard.epoch + 1
    full.alone.set_online(online=True)
    old.happen(old.sessions[name], TeacherLeft("ann"))
    with pytest.raises(JournalFenced):
        old.loop.commit()
    old.doors.close()
    full.settle()
    assert full.label(name, full.latest(name), 2) is not None
    assert [row.kind for row in read_rows(full.data_dir, name)].count("left") == 0
    assert [row.kind for row in read_rows(full.data_dir, name)].count("answer") == 2
    assert verify(full.data_dir).problems == ()


@pytest.mark.parametrize("verb", ["list", "show", "rows"])
def test_an_old_owner_that_wakes_up_answers_no_question(full: School, verb: str) -> None:
    name = next(name for name in NAMES if shard_of(name, SHARDS) == 2)
    (shard_directory(full.data_dir, 2) / "lock").unlink()
    replies: list[Reply | None] = []
    query = RowsQuery(session=name) if verb == "rows" else SessionQuery(session=name)
    full.watcher.ask(KEYS.learner(verb), encode(query), replies.append, 60_000)
    with pytest.raises(JournalFenced):
        full.settle()
    assert [reply for reply in replies if reply is not None and name.encode() in reply.payload] == []


class Desk(MemoryBus):
    """An operator's bus: whoever asks all learners is answered at once; `between` follows with the count."""

    def __init__(self, school: School, between: Callable[[int], None]) -> None:
        super().__init__(school.hub)
        self._school, self._between = school, between
        self.pages = 0

    def ask_all(
        self, key: str, payload: bytes, receive: Callable[[tuple[Reply, ...]], None], timeout_ms: int
    ) -> None:
        super().ask_all(key, payload, receive, timeout_ms)
        self._school.settle()
        self.pages += 1
        self._between(self.pages)


WIDE = World(level=ROOM, level_name="\N{SNOWMAN}" * 512, starts="1")
"""A level with a name of 1.5 KB: 38 of its sessions fit in a message."""


@pytest.fixture
def wide(school: School) -> School:
    """A school with 150 sessions: several pages, and another number of them for each learner."""
    names = [f"w{number}" for number in range(600)]
    for shard, count in enumerate((90, 10, 50)):
        for name in [name for name in names if shard_of(name, SHARDS) == shard][:count]:
            school.create_wide(name)
    assert [len(learner.sessions) for learner in school.learners.values()] == [90, 10, 50]
    return school


def test_all_pages_of_all_learners_are_listed_once(wide: School) -> None:
    desk = Desk(wide, lambda _: None)
    listed = Operator(desk, KEYS).sessions()
    names = [one.session for one in listed.sessions]
    assert sorted(names) == sorted(name for learner in wide.learners.values() for name in learner.sessions)
    assert len(set(names)) == len(names) == 150
    assert desk.pages > 2
    assert (listed.older, listed.shards, listed.told, untold(listed)) == (None, 3, (0, 1, 2), ())
    assert set(names[-SHARDS:]) == {list(learner.sessions)[-1] for learner in wide.learners.values()}


def test_sessions_created_between_two_pages_lose_nothing_and_double_nothing(wide: School) -> None:
    before = {name for learner in wide.learners.values() for name in learner.sessions}

    def create(page: int) -> None:
        for number in range(5):
            wide.create_wide(f"new{page}-{number}")

    desk = Desk(wide, create)
    names = [one.session for one in Operator(desk, KEYS).sessions().sessions]
    assert before <= set(names)
    assert len(set(names)) == len(names)
    assert desk.pages > 2


def test_a_shard_that_another_learner_takes_up_between_two_pages_loses_nothing(wide: School) -> None:
    """Its sessions lie in another order than that of their names, and must go on doing so."""

    def hand_over(page: int) -> None:
        if page == 1:
            wide.stop_shard(0)
            wide.start_shard(0, wide.alone)

    held = list(wide.learners[0].sessions)
    assert held != sorted(held)
    listed = Operator(Desk(wide, hand_over), KEYS).sessions()
    assert list(wide.learners[0].sessions) == held
    assert {one.session for one in listed.sessions} == {
        name for learner in wide.learners.values() for name in learner.sessions
    }
    assert untold(listed) == ()


def test_a_shard_without_a_learner_is_named_with_the_list(full: School) -> None:
    full.stop_shard(1)
    listed = Operator(Desk(full, lambda _: None), KEYS).sessions()
    assert sorted(one.session for one in listed.sessions) == sorted(
        name for name in NAMES if shard_of(name, SHARDS) != 1
    )
    assert (listed.shards, untold(listed)) == (SHARDS, (1,))


@pytest.mark.parametrize("gone", [1, 2])
def test_a_shard_whose_learner_dies_while_pages_are_read_is_named(wide: School, gone: int) -> None:
    stays = {name for shard in range(SHARDS) if shard != gone for name in wide.learners[shard].sessions}

    def stop(page: int) -> None:
        if page == 1:
            wide.stop_shard(gone)

    listed = Operator(Desk(wide, stop), KEYS).sessions()
    assert stays <= {one.session for one in listed.sessions}
    assert untold(listed) == (gone,)


def test_a_shard_that_comes_while_pages_are_read_is_named_since_its_first_page_was_missed(
    wide: School,
) -> None:
    wide.stop_shard(2)

    def start(page: int) -> None:
        if page == 2:  # the first one was asked for twice
            wide.start_shard(2, wide.alone)

    assert untold(Operator(Desk(wide, start), KEYS).sessions()) == (2,)
