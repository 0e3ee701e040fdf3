"""Of several learners one answers each question about a session; the others say nothing at all."""

from pathlib import Path
from typing import Any

import pytest

from protocol.codec import decode, encode
from protocol.messages import Branch, Control, Done, Join, Refusal, RowsQuery, SessionQuery
from services.learner.config import LearnerConfig
from services.learner.ownership import agree_on_shards, shard_of
from services.learner.service import Learner
from services.runtime.bus import Reply
from services.runtime.journal import Shard
from services.runtime.memory_bus import MemoryBus
from tests.services.learner.classroom import KEYS, Classroom, session

SHARDS = 3
NAME = "lesson"


class School(Classroom):
    """A learner for each of three shards."""

    def start_learner(self) -> None:
        agree_on_shards(self.data_dir, SHARDS)
        self.learners = [self._learner_of(shard) for shard in range(SHARDS)]
        self.settle()

    def _learner_of(self, shard: int) -> Learner:
        config = LearnerConfig(self.data_dir, shard=shard, shards=SHARDS)
        made = Learner(config, MemoryBus(self.hub), Shard.open(self.data_dir, shard), self.clock)
        made.open()
        return made

    def settle(self) -> None:
        while self.hub.deliver_all() or self._turned():
            pass

    def _turned(self) -> bool:
        for learner in self.learners if hasattr(self, "learners") else ():
            learner.loop.turn(0.0)
        return self.hub.deliver_all() > 0

    def heard(self, key: str, message: Any) -> tuple[Reply, ...]:  # noqa: ANN401 - any message
        """Return what everybody says together."""
        replies: list[tuple[Reply, ...]] = []
        self.watcher.ask_all(key, encode(message), replies.append, 60_000)
        self.settle()
        assert len(replies) == 1
        return replies[0]


@pytest.fixture
def school(tmp_path: Path) -> School:
    made = School(tmp_path / "data")
    (reply,) = made.heard(KEYS.learner("create"), session(session=NAME))
    assert decode(reply.payload, Done) == Done(ok=True)
    return made


def test_a_question_about_a_session_gets_one_reply_and_that_is_its_owners(school: School) -> None:
    asked = {
        "create": (KEYS.learner("create"), session(session=NAME)),
        "show": (KEYS.learner("show"), SessionQuery(session=NAME)),
        "rows": (KEYS.learner("rows"), RowsQuery(session=NAME)),
        "join": (KEYS.join(NAME, "ann"), Join(session=NAME, teacher="ann")),
        "control": (KEYS.control(NAME, "operator"), Control(session=NAME, teacher="operator", verb="pause")),
        "branch": (KEYS.learner("branch"), Branch(session=NAME, episode=0, branch=f"{NAME}-from0")),
    }
    said = {verb: [reply.ok for reply in school.heard(*question)] for verb, question in asked.items()}
    assert said == {verb: [True] for verb in asked}
    held = [sorted(learner.sessions) for learner in school.learners]
    assert held[shard_of(NAME, SHARDS)] == [NAME, f"{NAME}-from0"]
    assert sum(map(len, held)) == 2


@pytest.mark.parametrize("verb", ["show", "rows", "branch"])
def test_of_a_session_that_is_nowhere_one_learner_speaks(school: School, verb: str) -> None:
    asked = {
        "show": SessionQuery(session="nobody"),
        "rows": RowsQuery(session="nobody"),
        "branch": Branch(session="nobody", episode=0, branch="nobody-from0"),
    }
    (reply,) = school.heard(KEYS.learner(verb), asked[verb])
    assert decode(reply.payload, Refusal).code == "unknown-session"


@pytest.mark.parametrize("verb", ["join", "control"])
def test_a_key_that_may_not_be_is_refused_by_everybody(school: School, verb: str) -> None:
    key = f"{KEYS.root}/session/Not a name/{verb}/ann"
    messages = {
        "join": Join(session=NAME, teacher="ann"),
        "control": Control(session=NAME, teacher="ann", verb="pause"),
    }
    codes = [decode(reply.payload, Refusal).code for reply in school.heard(key, messages[verb])]
    assert codes == ["malformed"] * SHARDS
