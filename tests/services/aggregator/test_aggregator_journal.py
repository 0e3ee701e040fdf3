from pathlib import Path

from protocol.codec import decode
from protocol.crowd_journal import fold_crowd
from protocol.journal import Record
from protocol.messages import Acknowledgement, Refusal
from services.runtime.journal import JournalFull, Shard, verify
from sfid_core.teaching.answers import AnswerKind
from tests.services.aggregator.crowd_room import CROWD_KEYS, CrowdRoom
from tests.services.learner.classroom import Pupil, session

MIX = ("UP", "UP", "LEFT", "DOWN", "RIGHT")
NAMES = ("ann", "bob", "cat")


def teach(room: CrowdRoom, decisions: int) -> None:
    """Let three members answer decisions: two mostly agree, one says what comes next in MIX."""
    members = room.members(*NAMES)
    for member in members:
        member.sent = 1000 * room.asked.decision
    for number in range(decisions):
        for place, member in enumerate(members):
            member.label(MIX[(number * place) % 5])


def known(room: CrowdRoom) -> dict[str, tuple[float, float, int]]:
    """What the running aggregator knows of its workers, to the last bit."""
    assert room.aggregator is not None
    crowd = room.aggregator.crowds["s1"].crowd
    assert crowd is not None
    aggregate = crowd.aggregate(AnswerKind.LABEL)
    return {name: aggregate.reliability(name)[:3] for name in NAMES}


def test_the_journal_rebuilds_the_reliabilities_bit_for_bit(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    teach(crowd_room, 50)
    folded = crowd_room.folded()
    aggregate = folded.crowd.aggregate(AnswerKind.LABEL)
    assert {name: aggregate.reliability(name)[:3] for name in NAMES} == known(crowd_room)
    assert (folded.mismatches, folded.crowd.conclusions, len(folded.closings)) == ([], 50, 50)


def test_a_killed_aggregator_goes_on_where_its_journal_ends(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    teach(crowd_room, 20)
    before, epoch = known(crowd_room), crowd_room.asked.epoch
    crowd_room.kill_aggregator()
    crowd_room.start_aggregator()
    assert known(crowd_room) == before
    assert (crowd_room.asked.epoch, crowd_room.asked.decision) == (epoch + 1, 20)
    teach(crowd_room, 5)
    assert (crowd_room.asked.decision, crowd_room.folded().mismatches) == (25, [])


def test_what_was_acknowledged_before_a_kill_counts_after_it(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, bob = crowd_room.members("ann", "bob")
    message = ann.message(crowd_room.asked, action="UP")
    first = decode(ann.send(message).payload, Acknowledgement)
    crowd_room.kill_aggregator()
    crowd_room.start_aggregator()
    assert crowd_room.asked.phase == "asking"
    assert bob.label("UP") == "accepted"
    again = decode(ann.send(message).payload, Acknowledgement)
    assert [answer.action for answer in crowd_room.learner_answers()] == ["UP"]
    assert (again.code, again.journal_seq) == (first.code, first.journal_seq)


def test_a_conclusion_that_was_not_handed_on_before_a_kill_is_handed_on_after_it_once(
    crowd_room: CrowdRoom,
) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    crowd_room.kill_learner()
    assert ann.label("UP") == "accepted"  # acknowledged by the crowd while the learner is dead
    crowd_room.kill_aggregator()
    crowd_room.start_learner()
    assert crowd_room.learner_answers() == []
    crowd_room.start_aggregator()
    crowd_room.pass_time(2_000)
    crowd_room.pass_time(2_000)
    ids = [closing.handed for closing, _ in crowd_room.folded().closings]
    assert [answer.action for answer in crowd_room.learner_answers()] == ["UP"]
    assert len(ids) == 1
    assert crowd_room.decision.decision == 1


def test_an_aggregator_that_is_restarted_with_its_members_gone_lets_them_go(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, bob = crowd_room.members("ann", "bob")
    ann.label("UP")
    crowd_room.kill_aggregator()
    bob.bus.close()
    crowd_room.start_aggregator()
    assert crowd_room.asked.decision == 0  # bob may only be cut off
    crowd_room.pass_time(5_000)
    assert crowd_room.asked.decision == 1


def test_a_crowd_that_was_empty_before_a_restart_holds_nobody_up_after_it(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    tom = Pupil(crowd_room, "tom")
    tom.join()
    ann.leave()
    crowd_room.pass_time(100)
    crowd_room.kill_aggregator()
    crowd_room.start_aggregator()
    crowd_room.pass_time(5_000)
    crowd_room.pass_time(100)
    assert crowd_room.present() == ("tom",)


def test_a_learner_that_is_killed_finds_its_crowd_again(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    teach(crowd_room, 10)
    crowd_room.kill_learner()
    crowd_room.start_learner()
    crowd_room.pass_time(1_000)
    assert crowd_room.present() == ("crowd",)
    teach(crowd_room, 10)
    assert (crowd_room.decision.decision, crowd_room.folded().mismatches) == (20, [])


def test_what_was_said_before_the_learner_was_killed_counts_when_it_asks_again(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, bob = crowd_room.members("ann", "bob")
    for member in (ann, bob):
        member.label("UP")
    ann.label("UP")  # to decision 1, which the learner has not made durable yet
    crowd_room.kill_learner()
    crowd_room.start_learner()
    crowd_room.pass_time(1_000)
    assert (crowd_room.asked.decision, crowd_room.asked.phase) == (1, "asking")
    assert bob.label("UP") == "accepted"
    assert crowd_room.asked.decision == 2
    assert [closing.answered for closing, _ in crowd_room.folded().closings] == [2, 2]


def test_a_conclusion_that_comes_before_the_learner_stands_there_again_counts_then(
    crowd_room: CrowdRoom,
) -> None:
    crowd_room.create()
    (ann,) = crowd_room.members("ann")
    ann.label("UP")
    crowd_room.kill_learner()  # it asked for decision 1, and has not made durable how it came there
    assert ann.label("LEFT") == "accepted"
    crowd_room.tamper = lambda _verb, _reply: Refusal(code="busy", reason="wait")
    crowd_room.start_learner()
    for _ in range(3):
        crowd_room.pass_time(1_000)
    crowd_room.tamper = lambda _verb, reply: reply
    for _ in range(3):
        crowd_room.pass_time(1_000)
    answers = [(one.decision, one.action) for one in crowd_room.learner_answers()]
    assert answers == [(0, "UP"), (1, "LEFT")]
    assert (crowd_room.asked.decision, crowd_room.asked.phase) == (2, "asking")


def test_a_worker_who_is_forgotten_leaves_no_trace_in_the_reliabilities(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    teach(crowd_room, 30)
    without = crowd_room.folded("cat")
    rows = [row for row in crowd_room.crowd_rows() if row.person != "cat"]
    never = fold_crowd(Record(row.kind, row.at_ns, row.body or b"") for row in rows)
    assert never is not None
    assert "cat" not in without.known
    for name in NAMES:
        assert without.crowd.aggregate(AnswerKind.LABEL).reliability(name) == never.crowd.aggregate(
            AnswerKind.LABEL
        ).reliability(name)
    assert without.crowd.aggregate(AnswerKind.LABEL).reliability("cat").labels == 0
    assert known(crowd_room)["ann"] != without.crowd.aggregate(AnswerKind.LABEL).reliability("ann")[:3]


def test_forgetting_says_what_would_have_been_handed_on_without_the_worker(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    ann, bob, cat = crowd_room.members("ann", "bob", "cat")
    for member, action in ((ann, "UP"), (bob, "DOWN"), (cat, "UP")):
        member.label(action)
    ((row, with_cat),) = crowd_room.folded().closings
    ((same_row, without_cat),) = crowd_room.folded("cat").closings
    assert with_cat is not None
    assert without_cat is not None
    assert same_row == row
    assert (with_cat.kind, without_cat.kind) == (AnswerKind.LABEL, AnswerKind.ABSTAIN)


def test_the_journal_of_a_crowd_is_proven_like_any_other(crowd_room: CrowdRoom) -> None:
    crowd_room.create()
    teach(crowd_room, 10)
    directory = crowd_room.crowd_dir / "crowd-crowd"
    found = verify(directory)
    assert (found.ok, found.labels, found.sessions) == (True, 30, 1)


class FullDisk:
    """A shard on a disk that is full while the test says so."""

    def __init__(self, shard: Shard) -> None:
        self.shard, self.full = shard, True

    def __getattr__(self, name: str) -> object:
        return getattr(self.shard, name)

    def commit(self) -> None:
        if self.full:
            message = "no space left: free some"
            raise JournalFull(message)
        self.shard.commit()


def test_nothing_is_acknowledged_or_handed_on_that_the_disk_does_not_take(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(episodes=1))
    (ann,) = crowd_room.members("ann")
    aggregator = crowd_room.aggregator
    assert aggregator is not None
    disk = FullDisk(crowd_room.crowd_shard)
    aggregator.loop.shard = disk  # type: ignore[assignment]
    message = ann.message(crowd_room.asked, action="UP")
    refusal = crowd_room.refused(CROWD_KEYS.answer("s1", "ann"), message)
    assert (refusal.code, crowd_room.learner_answers()) == ("not-durable", [])
    assert isinstance(refusal, Refusal)
    disk.full = False
    crowd_room.pass_time(500)
    again = decode(ann.send(message).payload, Acknowledgement)
    assert again.code == "accepted"
    assert [answer.action for answer in crowd_room.learner_answers()] == ["UP"]


def test_a_crowds_journal_lies_beside_that_of_the_learner(tmp_path: Path) -> None:
    room = CrowdRoom(tmp_path / "data")
    room.create()
    room.members("ann")
    room.close()
    assert sorted(path.name for path in (tmp_path / "crowd-data" / "crowd-crowd").iterdir()) == ["shard-0"]
