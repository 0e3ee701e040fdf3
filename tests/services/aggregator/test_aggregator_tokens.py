"""A crowd that requires tokens, before a learner that requires them too."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from protocol.codec import decode
from protocol.messages import Acknowledgement, Join, Refusal
from services.runtime.memory_bus import MemoryBus
from services.runtime.register import Register
from tests.services.aggregator.crowd_room import CROWD_KEYS, EARLY, CrowdRoom, Member
from tests.services.learner.classroom import session
from tests.services.learner.guarded_room import ID, GuardedRoom


class GuardedCrowd(GuardedRoom, CrowdRoom):
    """A crowd's room where both ends require tokens, signed with one secret."""

    def start_learner(self) -> None:
        """Open the learner; the aggregator has its directory: one deployment, one secret."""
        self.crowd_dir = self.data_dir
        super().start_learner()

    def enter(self, member: Member, token: str | None) -> bytes:
        member.withdraw = member.bus.announce(CROWD_KEYS.present("s1", member.name))
        message = Join(session="s1", teacher=member.name, token=token)
        return self.ask(member.bus, CROWD_KEYS.join("s1", member.name), message).payload


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[GuardedCrowd]:
    made = GuardedCrowd(tmp_path / "data", config={"require_tokens": True})
    made.create(session(window=EARLY))
    yield made
    made.close()


def test_a_member_with_their_token_is_heard_and_the_crowd_bears_one_to_the_learner(
    guarded: GuardedCrowd,
) -> None:
    ann, token = Member(guarded, "ann"), guarded.token("ann")
    guarded.enter(ann, token)
    reply = ann.send(ann.message(guarded.asked, action="UP", token=token))
    assert decode(reply.payload, Acknowledgement).code == "accepted"
    guarded.settle()
    (handed,) = guarded.learner_answers()
    assert (handed.teacher, handed.token) == ("crowd", None)
    door = guarded.learner.reception.desk.door
    assert door is not None
    assert dict(door.refused) == {}
    for path in guarded.data_dir.rglob("*"):
        assert not path.is_file() or token.encode() not in path.read_bytes()


def test_members_without_a_token_of_their_own_are_refused_counted_and_leave_nothing(
    guarded: GuardedCrowd,
) -> None:
    eve, mallory = Member(guarded, "eve"), Member(guarded, "mallory")
    stolen = guarded.token("ann")
    refused = [
        decode(guarded.enter(member, token), Refusal)
        for member, token in ((eve, None), (eve, stolen), (mallory, stolen + "x"),
                              (eve, guarded.token("eve", session="s2")))
    ]  # fmt: skip
    assert [one.reason.partition(":")[0] for one in refused] == [
        "missing-token",
        "token-of-another-name",
        "forged-token",
        "token-of-another-session",
    ]
    assert {one.code for one in refused} == {"denied"}
    assert guarded.aggregator is not None
    door = guarded.aggregator.reception.desk.door
    assert door is not None
    assert sum(door.refused.values()) == len(refused)
    assert guarded.crowd_rows() == []


def test_a_member_whose_token_is_revoked_is_heard_no_more(guarded: GuardedCrowd) -> None:
    ann, token = Member(guarded, "ann"), guarded.token("ann")
    guarded.enter(ann, token)
    answer = ann.message(guarded.asked, action="UP", token=token)
    assert decode(ann.send(answer).payload, Acknowledgement).code == "accepted"
    Register(guarded.data_dir / "gateway").revoke(ID)
    again = msgspec.structs.replace(answer, answer_id=b"another answer.."[:16])
    assert decode(ann.send(again).payload, Refusal).reason.startswith("revoked-token")


def test_a_member_who_comes_back_is_counted_in_by_their_token_and_not_by_their_presence(
    guarded: GuardedCrowd,
) -> None:
    """Anybody may announce anybody: where tokens are required, a name alone brings nobody back."""
    ann, token = Member(guarded, "ann"), guarded.token("ann")
    guarded.enter(ann, token)
    assert guarded.aggregator is not None
    crowd = guarded.aggregator.crowds["s1"].crowd
    assert crowd is not None
    ann.withdraw()
    guarded.settle()
    assert set(crowd.members) == set()
    MemoryBus(guarded.hub).announce(CROWD_KEYS.present("s1", "ann"))
    guarded.settle()
    assert set(crowd.members) == set()
    guarded.enter(ann, token)
    guarded.settle()
    assert set(crowd.members) == {"ann"}


def test_a_crowd_waits_no_longer_for_a_member_whose_token_is_revoked(guarded: GuardedCrowd) -> None:
    ann = Member(guarded, "ann")
    guarded.enter(ann, guarded.token("ann"))
    assert guarded.aggregator is not None
    crowd = guarded.aggregator.crowds["s1"].crowd
    assert crowd is not None
    assert set(crowd.members) == {"ann"}
    Register(guarded.data_dir / "gateway").revoke(ID)
    guarded.pass_time(1_000)
    assert set(crowd.members) == set()
