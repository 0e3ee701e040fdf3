"""Where tokens are required, nobody is counted in because somebody announced them."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.identity import Identity, Role, sign
from services.learner.config import LearnerConfig
from services.learner.service import Learner
from services.runtime.memory_bus import MemoryBus
from services.runtime.register import new_token_id
from services.runtime.secret import load_secrets
from tests.services.gateway.gateway_house import gateway
from tests.services.learner.classroom import KEYS, Classroom, Pupil


class GuardedRoom(Classroom):
    """A classroom whose learner requires tokens."""

    def start_learner(self) -> None:
        self.shard = self.open_shard(self.data_dir)
        self.bus = MemoryBus(self.hub)
        config = LearnerConfig(self.data_dir, require_tokens=True)
        self.learner = Learner(config, self.bus, self.shard, self.clock)
        self.learner.open()
        self.settle()

    def token(self, name: str) -> str:
        """Return a token for an hour."""
        identity = Identity(
            role=Role.TEACHER, session="s1", pseudonym=name, token_id=new_token_id(),
            expires_s=self.clock.wall_ns() // 1_000_000_000 + 3_600,
        )  # fmt: skip
        return sign(identity, load_secrets(self.data_dir / "gateway"))


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[GuardedRoom]:
    made = GuardedRoom(tmp_path / "data")
    made.create()
    yield made
    made.shard.discard_pending()
    made.shard.close()


def test_whoever_is_announced_again_is_not_there_before_they_join_with_their_token(
    guarded: GuardedRoom,
) -> None:
    ann = Pupil(guarded, "ann")
    ann.join(token=guarded.token("ann"))
    assert guarded.present() == ("ann",)
    ann.withdraw()
    guarded.settle()
    assert guarded.present() == ()
    rows = len(guarded.rows())
    MemoryBus(guarded.hub).announce(KEYS.present("s1", "ann"))
    guarded.settle()
    assert (guarded.present(), len(guarded.rows())) == ((), rows)
    ann.join(token=guarded.token("ann"))
    assert guarded.present() == ("ann",)


def test_everybody_at_the_page_joins_again_when_the_router_came_back(tmp_path: Path) -> None:
    with gateway(tmp_path / "data") as house:
        for name in ("ann", "bea"):
            house.teacher(name)
        came = threading.Event()
        before = len(house.learner.joins)
        house.learner.on_join = lambda joins: came.set() if joins == before + 2 else None
        house.bus.set_online(online=False)
        house.bus.set_online(online=True)
        assert came.wait(5.0)
        assert {join.teacher for join in house.learner.joins[before:]} == {"ann", "bea"}
