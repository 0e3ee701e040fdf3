import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from protocol.messages import GymWorld, Refusal
from services.cli.shared.gym_options import best_actions
from services.runtime.memory_bus import MemoryBus, MemoryHub
from services.teachers.crowd import CrowdConfig, CrowdError, SimulatedCrowd, run
from services.teachers.scripted import Best, ScriptedError
from sfid_core.learning.parameters import ParameterError
from sfid_core.teaching.answers import AnswerKind
from sfid_core.teaching.crowd_mix import parse_mix
from tests.services.aggregator.crowd_room import EARLY, CrowdRoom
from tests.services.gym.lakes import DRY_LAKE, TAXI
from tests.services.learner.classroom import session
from tests.services.teachers.fake_learner import FakeLearner


@pytest.fixture
def crowd_room(tmp_path: Path) -> Iterator[CrowdRoom]:
    made = CrowdRoom(tmp_path / "data")
    yield made
    made.close()


def enter(room: CrowdRoom, mix: str, best: Best | None = None, **settings: Any) -> SimulatedCrowd:  # noqa: ANN401 - any field
    """Let a simulated crowd into the room."""
    config = CrowdConfig("s1", parse_mix(mix), seed=3, **settings)
    crowd = SimulatedCrowd(config, MemoryBus(room.hub), room.clock, best=best)
    crowd.open()
    room.actors.append(lambda: crowd.turn(0.0))
    room.settle()
    return crowd


def test_a_simulated_crowd_teaches_a_session_to_its_end(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(episodes=3))
    crowd = enter(crowd_room, "good:4,random:2,adversary:1")
    assert (crowd_room.finished, crowd.finished, crowd.unacknowledged) == (True, True, 0)
    decisions = len(crowd_room.steps)
    assert [(one.accepted, one.too_late, one.rejected, one.left) for one in crowd.results()] == [
        (decisions, 0, 0, 0)
    ] * 7
    assert len(crowd_room.crowd_rows("answer")) == 7 * decisions


def test_who_is_reliable_is_found_out(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(episodes=6))
    enter(crowd_room, "good:6,random:2,adversary:2")
    known = crowd_room.folded().crowd.aggregate(AnswerKind.LABEL)
    means = {worker: known.reliability(worker).mean for worker in known.workers()}
    assert min(mean for worker, mean in means.items() if "good" in worker) > 0.65
    assert max(mean for worker, mean in means.items() if "random" in worker) < 0.6
    assert max(mean for worker, mean in means.items() if "adversary" in worker) < 0.3


@pytest.mark.parametrize("world, rides", [(DRY_LAKE, 6), (TAXI, None)])
def test_a_crowd_teaches_an_environment_to_its_known_optimum(
    crowd_room: CrowdRoom, world: GymWorld, rides: int | None
) -> None:
    crowd_room.create(session(world=world, episodes=3, method="guide"))
    best = best_actions(world)
    crowd = enter(crowd_room, "expert:3,random:1,adversary:1", best=best)
    assert crowd_room.finished
    assert {one.rejected for one in crowd.results()} == {0}
    right = [
        world.actions.index(answer.action) in best[answer.state]
        for answer in crowd_room.learner_answers()
        if answer.action is not None
    ]
    assert sum(right) / len(right) > 0.9
    assert rides is None or [one.steps for one in crowd_room.episodes][-1] == rides


def test_a_crowd_that_is_told_of_no_environment_says_so_where_one_is_taught(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(world=DRY_LAKE))
    with pytest.raises(ScriptedError, match=r"^the session's world is no Sokoban .* name it with the --gym"):
        enter(crowd_room, "expert:1")


@pytest.mark.parametrize("method,kinds", [
    ("reward", {"reward"}), ("guidance", {"guidance", "reward"}), ("marks", {"mistake"}),
])  # fmt: skip
def test_a_simulated_crowd_answers_what_is_asked(crowd_room: CrowdRoom, method: str, kinds: set[str]) -> None:
    crowd_room.create(session(episodes=1, method=method))
    crowd = enter(crowd_room, "expert:3")
    said = {answer.kind for answer in crowd_room.learner_answers()}
    assert crowd_room.finished
    assert kinds <= said <= {*kinds, "abstain"}
    assert {one.rejected for one in crowd.results()} == {0}


def test_each_worker_thinks_at_a_pace_of_their_own(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(window=EARLY))
    enter(crowd_room, "good:8", delay_ms=400)
    for _ in range(60):
        crowd_room.pass_time(10)
    rows = crowd_room.crowd_rows("answer")[:8]
    asked_at_ns = crowd_room.crowd_rows("asked")[0].at_ns
    waits_ms = sorted((row.at_ns - asked_at_ns) // 1_000_000 for row in rows)
    assert waits_ms[0] >= 200
    assert waits_ms[-1] <= 610
    assert len(set(waits_ms)) > 4


def test_workers_who_drop_out_stop_nobody(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(episodes=4))
    crowd = enter(crowd_room, "good:12", dropout_rate=0.02)
    left = [one.left for one in crowd.results()]
    assert max(left) == 1
    for _ in range(10):
        crowd_room.pass_time(1_000)
    assert crowd.finished
    assert crowd_room.finished or sum(left) == 12


def test_who_comes_back_goes_on(crowd_room: CrowdRoom) -> None:
    crowd_room.create(session(episodes=4))
    crowd = enter(crowd_room, "good:6", dropout_rate=0.05, away_ms=2_000)
    for _ in range(200):
        if crowd_room.finished:
            break
        crowd_room.pass_time(500)
    results = crowd.results()
    assert crowd_room.finished
    assert max(one.left for one in results) > 1
    assert all(one.accepted > 0 and one.unacknowledged == 0 for one in results)


def test_a_crowd_that_is_not_let_in_says_so() -> None:
    hub = MemoryHub(inline=True)
    learner = FakeLearner(MemoryBus(hub))
    learner.join_refusal = Refusal(code="denied", reason="this session is closed")
    config = CrowdConfig("s1", parse_mix("good:2"), deployment="local")
    with pytest.raises(CrowdError, match=r"^session 's1': this session is closed \(denied\)$"):
        run(config, MemoryBus(hub), lambda: None, threading.Event())


def test_a_crowd_needs_no_aggregator() -> None:
    hub = MemoryHub(inline=True)
    learner = FakeLearner(MemoryBus(hub))
    answered: set[str] = set()

    def on_answer(answer: Any) -> None:  # noqa: ANN401 - an Answer
        answered.add(answer.teacher)
        if len(answered) == 3:
            learner.go_on(phase="finished")

    learner.on_answer = on_answer
    config = CrowdConfig("s1", parse_mix("expert:3"), deployment="local")
    results = run(config, MemoryBus(hub), lambda: None, threading.Event())
    assert [(one.worker, one.accepted) for one in results] == [(f"w-expert-{n}", 1) for n in (1, 2, 3)]


@pytest.mark.parametrize("wrong", [{"delay_ms": -1}, {"away_ms": -1}, {"dropout_rate": 1.5}])
def test_settings_that_cannot_be_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ParameterError):
        CrowdConfig("s1", parse_mix("good:1"), **wrong)
