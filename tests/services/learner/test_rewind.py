"""Going back to an earlier episode: a branch that knows what was learnt until then, and nothing after."""

import msgspec
import pytest

from protocol.branching import read_origin
from protocol.codec import decode
from protocol.forgetting import forget_in_session
from protocol.journal import Kind, Record, fold
from protocol.messages import Branch, Control, Decision, Done, Join, Wire
from services.exports.session_story import read_story
from services.monitor.replayed import messages_of
from services.replay import replay_directory
from services.runtime.journal import verify
from sfid_core.teaching.personas import persona_named
from sfid_core.teaching.simulated import SimulatedTeacher
from tests.services.learner.classroom import KEYS, Classroom, Pupil, session


def mind(name: str) -> SimulatedTeacher:
    return SimulatedTeacher(1, name, "s1", persona_named("oracle", {}))


def taught(room: Classroom, episodes: int = 4, **changes: object) -> Pupil:
    """A session of ann's, taught to its end."""
    room.create(session(episodes=episodes, **changes))
    ann = Pupil(room, "ann")
    ann.join()
    room.teach({ann: mind("ann")}, lambda: room.finished)
    return ann


def rewound(room: Classroom, episode: int, name: str = "again", origin: str = "s1") -> Wire:
    message = Branch(session=origin, episode=episode, branch=name)
    reply = room.ask(room.watcher, KEYS.learner("branch"), message)
    return decode(reply.payload, Done)


def told(room: Classroom, name: str) -> list[Record]:
    return [Record(*each) for each in room.shard.events(name)]


def digest_after(room: Classroom, episodes: int) -> str:
    """What the session had learnt after so many episodes, from its rows alone."""
    records = told(room, "s1")
    begins = [number for number, record in enumerate(records) if record.kind == Kind.BEGAN.value]
    folded = fold(records[: begins[episodes]])
    assert folded is not None
    return folded.session.learner.sha256()


@pytest.mark.parametrize("method", ["sfid", "reward"])
def test_a_branch_knows_what_was_learnt_before_the_episode_and_nothing_after(
    room: Classroom, method: str
) -> None:
    taught(room, method=method)
    before = room.report("s1")
    assert rewound(room, 2) == Done(ok=True)
    branch = room.report("again")
    assert (branch.summary.episode, branch.summary.paused) == (2, True)
    assert branch.q_sha256 == digest_after(room, 2) != before.q_sha256
    now = {"session": "again", "decision": branch.summary.decision}
    assert branch.episodes == tuple(msgspec.structs.replace(each, **now) for each in before.episodes[:2])
    assert branch.summary.teachers == ()
    assert room.report("s1") == before


def test_the_branch_is_taught_on_and_its_origin_stays_as_it_is(room: Classroom) -> None:
    taught(room)
    before = room.report("s1")
    rewound(room, 1)
    eve = _Newcomer(room, "eve")
    eve.join()
    eve.resume()
    eve.teach()
    after = room.report("again")
    assert after.summary.phase == "finished"
    assert len(after.episodes) == 4
    assert after.episodes[0].steps == before.episodes[0].steps
    assert room.report("s1") == before


def test_who_taught_the_origin_is_no_teacher_of_the_branch_before_they_join_it(room: Classroom) -> None:
    """A token alone brings back who was there before; in the branch nobody was."""
    ann = taught(room)
    rewound(room, 1)
    ann.bus.announce(KEYS.present("again", "ann"))
    room.settle()
    assert room.report("again").summary.teachers == ()
    eve = _Newcomer(room, "eve")
    eve.join()
    assert room.report("again").summary.teachers == ("eve",)


def test_the_same_branch_again_is_the_same_and_another_of_its_name_is_refused(room: Classroom) -> None:
    taught(room)
    assert rewound(room, 1) == rewound(room, 1) == Done(ok=True)
    rows = len(told(room, "again"))
    refusal = room.refused(KEYS.learner("branch"), Branch(session="s1", episode=2, branch="again"))
    assert refusal.code == "conflict"
    assert (
        room.refused(KEYS.learner("branch"), Branch(session="s1", episode=1, branch="s1")).code == "conflict"
    )
    assert len(told(room, "again")) == rows


@pytest.mark.parametrize(
    "origin, episode, code, reason",
    [
        ("s1", 4, "invalid", "has not begun episode 4: choose one from 0 to 3"),
        ("nobody", 0, "unknown-session", "no session nobody here"),
    ],
)
def test_what_has_not_been_cannot_be_gone_back_to(
    room: Classroom, origin: str, episode: int, code: str, reason: str
) -> None:
    taught(room)
    refusal = room.refused(KEYS.learner("branch"), Branch(session=origin, episode=episode, branch="again"))
    assert refusal.code == code
    assert reason in refusal.reason


def test_before_the_first_episode_and_within_one_the_last_that_began_is_told(room: Classroom) -> None:
    room.create(session(episodes=5))

    def reason() -> str:
        return room.refused(KEYS.learner("branch"), Branch(session="s1", episode=3, branch="again")).reason

    assert reason() == "session s1 has not begun episode 3: none has begun"
    Pupil(room, "ann").join()
    assert reason() == "session s1 has not begun episode 3: choose one from 0 to 0"


def test_a_session_that_goes_on_can_be_branched_and_goes_on(room: Classroom) -> None:
    room.create(session(episodes=5))
    ann = Pupil(room, "ann")
    ann.join()
    room.teach({ann: mind("ann")}, lambda: len(room.episodes) == 2)
    rewound(room, 0)
    assert (room.report("again").summary.episode, room.report("again").labels.submitted) == (0, 0)
    room.decisions[:] = [each for each in room.decisions if each.session == "s1"]
    ann.send(ann.message(room.decision, action="UP"))
    assert room.report("s1").labels.submitted > 0


def test_replay_verify_and_export_understand_a_branch(room: Classroom) -> None:
    taught(room)
    rewound(room, 2)
    rewound(room, 1, "twice", "again")
    room.pass_time(600)
    room.shard.close()
    replayed = {each.session: each for each in replay_directory(room.data_dir)}
    assert all(each.matches and each.digests for each in replayed.values())
    assert [replayed[name].episodes for name in ("s1", "again", "twice")] == [4, 2, 1]
    assert verify(room.data_dir).problems == ()
    story = read_story(room.data_dir, "again")
    origin = read_story(room.data_dir, "s1")
    assert [row.action for row in story.steps] == [row.action for row in origin.steps[: len(story.steps)]]
    assert [row.measures.values for row in story.steps] == [
        row.measures.values for row in origin.steps[: len(story.steps)]
    ]
    assert sum(isinstance(each, Decision) for each in messages_of(room.data_dir, "again")) > len(story.steps)


def test_a_branch_says_where_it_is_from_and_survives_a_killed_learner(room: Classroom) -> None:
    taught(room)
    rewound(room, 2)
    digest = room.report("again").q_sha256
    (origin,) = (row for row in room.rows("branched"))
    first_left_out = [row.seq for row in room.rows("began") if row.session == "s1"][2]
    assert read_origin(origin.body or b"") == ("s1", first_left_out, 2)
    room.kill_learner()
    room.start_learner()
    assert room.report("again").q_sha256 == digest


def test_who_is_forgotten_is_forgotten_in_the_branch_too(room: Classroom) -> None:
    taught(room)
    rewound(room, 2)
    rows = [
        (row.seq, Record(row.kind, row.at_ns, row.body))
        for row in room.shard.rows("again")
        if row.body is not None
    ]
    forgotten = forget_in_session(rows, "ann", {})
    assert forgotten is not None
    assert forgotten.answers == room.report("again").labels.submitted
    kept = [
        record._replace(body=forgotten.amendments.get(seq, record.body) or b"")
        for seq, record in rows
        if forgotten.amendments.get(seq, record.body) is not None
    ]
    assert [record.kind for record in kept if b"\xa3ann" in record.body] == []
    again = fold(kept)
    assert again is not None
    assert (again.mismatches, again.session.learner.sha256()) == ([], forgotten.q_sha256)


class _Newcomer(Pupil):
    """A teacher of the branch."""

    def join(self, **_changes: object) -> None:  # type: ignore[override]
        self.withdraw = self.bus.announce(KEYS.present("again", self.name))
        self.room.ask(self.bus, KEYS.join("again", self.name), Join(session="again", teacher=self.name))

    def resume(self) -> None:
        message = Control(session="again", teacher="operator", verb="resume")
        self.room.ask(self.room.watcher, KEYS.control("again", "operator"), message)

    def teach(self) -> None:
        knows = mind(self.name)
        while self.room.decision.phase != "finished":
            decision = self.room.decision
            assert decision.session == "again"
            answer = msgspec.structs.replace(self.room.opinion(self, knows, decision), session="again")
            self.room.ask(self.bus, KEYS.answer("again", self.name), answer)
            assert self.room.decision is not decision
