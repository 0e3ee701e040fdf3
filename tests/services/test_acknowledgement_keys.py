"""An acknowledgement that another client made up is not believed."""

from hashlib import blake2b
from pathlib import Path

import pytest

from protocol.codec import decode, encode
from protocol.identity import check_key
from protocol.messages import Acknowledgement
from services.client import AnswerState, AnswerUpdate, Client, Welcomed
from services.learner.config import LearnerConfig
from services.learner.service import Learner
from services.outbox import Outbox
from services.runtime.bus import Request
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.learner.classroom import Classroom, Pupil
from tests.services.teachers.fake_learner import KEYS, FakeLearner

SECRETS = (b"the oldest secret of thirty-two bytes", b"a newer one, also of thirty-two bytes")
SECOND_NS = 1_000_000_000


class KeyedRoom(Classroom):
    """A classroom whose learner keys its checks."""

    def start_learner(self) -> None:
        self.shard = self.open_shard(self.data_dir)
        self.bus = MemoryBus(self.hub)
        config = LearnerConfig(self.data_dir, check_secrets=SECRETS)
        self.learner = Learner(config, self.bus, self.shard, self.clock)
        self.learner.open()
        self.settle()


def test_each_teacher_has_a_key_and_it_outlives_the_learner(tmp_path: Path) -> None:
    room = KeyedRoom(tmp_path / "data")
    room.create()
    ann, bea = Pupil(room, "ann"), Pupil(room, "bea")
    keys = [pupil.join().check_key for pupil in (ann, bea)]
    assert keys == [check_key("s1", name, SECRETS) for name in ("ann", "bea")]
    assert len(set(keys)) == 2
    answer = ann.message(room.decision, action="UP")
    first = ann.send(answer)
    room.kill_learner()
    room.start_learner()
    again, payload = ann.send(answer), first.payload
    told = [decode(reply.payload, Acknowledgement).check for reply in (first, again)]
    room.shard.discard_pending()
    room.shard.close()
    right = blake2b(encode(answer), digest_size=8, key=keys[0] or b"").digest()
    assert (told, payload == b"") == ([right, right], False)


def joined(learner_key: bytes | None, pinned: bytes | None) -> tuple[FakeLearner, Client, ManualClock]:
    clock = ManualClock(SECOND_NS)
    hub = MemoryHub(clock, inline=True)
    learner = FakeLearner(MemoryBus(hub))
    learner.check_key = learner_key
    client = Client(
        MemoryBus(hub), KEYS, "s1", "ann", outbox=Outbox(), clock=clock, check_key=pinned
    )  # fmt: skip
    return learner, client, clock


def without_the_key(learner: FakeLearner) -> None:
    """Let the next acknowledgement be one of somebody who saw the answer, and has not the key."""

    def forge(request: Request) -> None:
        kept, learner.check_key = learner.check_key, None
        request.reply(learner.acknowledgement(request.payload))
        learner.check_key = kept

    learner.answer_replies.append(forge)


def test_who_has_not_the_key_cannot_say_saved() -> None:
    learner, client, clock = joined(b"k" * 32, None)
    without_the_key(learner)
    found: list[AnswerState] = []
    with client:
        while client.next(0) is not None:
            pass
        client.answer(learner.decision, action="LEFT")
        for _ in range(40):
            while (update := client.next(0)) is not None:
                found += [update.state] if isinstance(update, AnswerUpdate) else []
            clock.advance(SECOND_NS // 20)
    assert found == [AnswerState.SENDING, AnswerState.RETRYING, AnswerState.SAVED]
    assert learner.payloads[0] == learner.payloads[1]


@pytest.mark.parametrize("theirs,welcomed", [(b"k" * 32, True), (b"x" * 32, False), (None, False)])
def test_a_key_that_came_with_the_token_is_asked_of_whoever_welcomes(
    *, theirs: bytes | None, welcomed: bool
) -> None:
    _, client, clock = joined(theirs, b"k" * 32)
    updates = []
    with client:
        for _ in range(40):
            while (update := client.next(0)) is not None:
                updates.append(update)
            clock.advance(SECOND_NS // 20)
    assert any(isinstance(update, Welcomed) for update in updates) is welcomed
    assert (client.unreadable > 0) is not welcomed
