"""A crowd under seeded mischief: whatever is killed and whoever leaves, what was said stays said."""

import os
import random
from pathlib import Path

import pytest

from protocol.codec import decode
from protocol.journal import read_answer_body
from protocol.messages import Acknowledgement, Answer, WindowSpec
from services.runtime.journal import verify
from tests.services.aggregator.crowd_room import CrowdRoom, Member
from tests.services.learner.classroom import session

SEEDS = int(os.environ.get("SFID_CROWD_SEEDS", "12"))
"""Longer runs are the same with a larger number."""
NAMES = ("ann", "bob", "cat", "dan")
WINDOWS = (
    WindowSpec(mode="early", span_ms=800),
    WindowSpec(mode="full", span_ms=800),
    WindowSpec(mode="until-answered", span_ms=800),
)


class Mischief:
    """One seeded run; keeps what members were told."""

    def __init__(self, room: CrowdRoom, seed: int) -> None:
        self.room, self.chance = room, random.Random(seed)
        self.told: dict[bytes, tuple[Answer, Acknowledgement]] = {}
        room.create(session(episodes=50, window=WINDOWS[seed % 3]))
        self.members = room.members(*NAMES)
        self.here = set(NAMES)
        self.doings = (
            *(self.label,) * 12, self.repeat, self.wait, self.wait, self.go, self.come,
            self.kill_aggregator, self.kill_learner,
        )  # fmt: skip

    def run(self, doings: int) -> None:
        for _ in range(doings):
            self.chance.choice(self.doings)()

    def label(self) -> None:
        member = self.chance.choice([one for one in self.members if one.name in self.here])
        asked = self.chance.choice(self.room.seen[-3:])
        self.send(member, member.message(asked, action=self.chance.choice(asked.actions)))

    def send(self, member: Member, answer: Answer) -> None:
        reply = member.send(answer)
        if reply.ok:
            self.told[answer.answer_id] = (answer, decode(reply.payload, Acknowledgement))

    def repeat(self) -> None:
        if not self.told:
            return
        answer, before = self.chance.choice(list(self.told.values()))
        member = next(one for one in self.members if one.name == answer.teacher)
        self.send(member, answer)
        again = self.told[answer.answer_id][1]
        assert (again.code, again.journal_seq) == (before.code, before.journal_seq)

    def wait(self) -> None:
        self.room.pass_time(self.chance.choice((10, 200, 900, 5_000)))

    def go(self) -> None:
        if len(self.here) > 1:
            member = self.chance.choice([one for one in self.members if one.name in self.here])
            self.here.discard(member.name)
            member.leave()

    def come(self) -> None:
        for member in self.members:
            if member.name not in self.here:
                member.join()
                self.here.add(member.name)

    def kill_aggregator(self) -> None:
        self.room.kill_aggregator()
        self.room.start_aggregator()
        self.room.pass_time(1_000)

    def kill_learner(self) -> None:
        self.room.kill_learner()
        self.room.start_learner()
        self.room.pass_time(1_000)


@pytest.mark.parametrize("seed", range(SEEDS))
def test_whatever_is_killed_nothing_acknowledged_is_lost(tmp_path: Path, seed: int) -> None:
    room = CrowdRoom(tmp_path / "data")
    mischief = Mischief(room, seed)
    mischief.run(120)
    folded = room.folded()
    journaled: dict[bytes, list[tuple[str, Answer]]] = {}
    for row in room.crowd_rows("answer"):
        assert row.body is not None
        assert row.unique is not None
        code, _, payload = read_answer_body(row.body)
        journaled.setdefault(row.unique, []).append((code.value, decode(payload, Answer)))
    expected = {answer_id: [(told.code, answer)] for answer_id, (answer, told) in mischief.told.items()}
    assert journaled == expected
    assert folded.mismatches == []
    handed = [decode(closing.handed, Answer) for closing, _ in folded.closings if closing.handed]
    reached = [answer for answer in room.learner_answers() if answer.teacher == "crowd"]
    # What the learner has is what was concluded, in order, each once; all of it but what is on its way.
    assert [one for one in handed if one in reached] == reached
    assert len(handed) - len(reached) <= 1
    assert len(folded.closings) > 3
    room.close()
    assert verify(room.crowd_dir / "crowd-crowd").ok
