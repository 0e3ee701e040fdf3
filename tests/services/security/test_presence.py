"""Where tokens are required, nobody is counted in because somebody announced them."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.codec import decode
from protocol.identity import verify
from protocol.messages import Acknowledgement
from services.runtime.memory_bus import MemoryBus
from services.runtime.register import Register
from services.runtime.secret import load_secrets
from tests.services.gateway.gateway_house import gateway
from tests.services.learner.classroom import KEYS, Pupil
from tests.services.learner.guarded_room import GuardedRoom

OTHER_ID = "00000000000000b1"


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


@pytest.mark.parametrize("how", ["revoked", "expired"])
def test_nobody_waits_for_a_teacher_whose_token_is_no_longer_good(guarded: GuardedRoom, how: str) -> None:
    ann, bea = Pupil(guarded, "ann"), Pupil(guarded, "bea")
    token = guarded.token("bea", token_id=OTHER_ID)
    ann.join(token=guarded.token("ann", hours=2))
    bea.join(token=token)
    opened = guarded.decision.decision
    answer = ann.message(guarded.decision, action="UP", token=guarded.token("ann", hours=2))
    assert decode(ann.send(answer).payload, Acknowledgement).code == "accepted"
    assert (guarded.decision.decision, guarded.present()) == (opened, ("ann", "bea"))
    if how == "revoked":
        secrets = load_secrets(guarded.data_dir / "gateway")
        Register(guarded.data_dir / "gateway").revoke(verify(token, secrets, 0, ()).token_id)
        guarded.pass_time(1_000)
    else:
        guarded.clock.advance(3_600 * 1_000_000_000)
        guarded.settle()
    assert (guarded.decision.decision, guarded.present()) == (opened + 1, ("ann",))


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


def test_after_a_restart_nobody_is_waited_for_whose_token_was_withdrawn_meanwhile(
    guarded: GuardedRoom,
) -> None:
    ann, bea = Pupil(guarded, "ann"), Pupil(guarded, "bea")
    token = guarded.token("bea", token_id=OTHER_ID)
    ann.join(token=guarded.token("ann", hours=2))
    bea.join(token=token)
    opened = guarded.decision.decision
    guarded.shard.commit()
    guarded.kill_learner()
    folder = guarded.data_dir / "gateway"
    Register(folder).revoke(verify(token, load_secrets(folder), 0, ()).token_id)
    guarded.start_learner()
    ann.join(token=guarded.token("ann", hours=2))
    ann.send(ann.message(guarded.decision, action="UP", token=guarded.token("ann", hours=2)))
    guarded.pass_time(20_000)
    assert guarded.present() == ("ann",)
    assert guarded.decision.decision > opened
