"""Teachers against a fake learner over a real router (ring 3)."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.messages import Answer
from services.client import join
from services.router import free_endpoint
from services.runtime.bus import BusError
from services.runtime.zenoh_bus import ZenohRouter, open_bus
from services.teachers.scripted import ScriptedConfig, run
from tests.services.teachers.fake_learner import FakeLearner

pytestmark = pytest.mark.real
DECISIONS = 20


@pytest.fixture
def endpoint() -> Iterator[str]:
    endpoint = free_endpoint()
    router = ZenohRouter(endpoint, "the port is taken")
    yield endpoint
    router.close()


@pytest.fixture
def learner(endpoint: str) -> Iterator[FakeLearner]:
    bus = open_bus(endpoint, 5000)
    learner = FakeLearner(bus)

    def next_decision(answer: Answer) -> None:
        learner.go_on(phase="executing")
        if answer.decision + 1 == DECISIONS:
            learner.go_on(phase="finished")
        else:
            learner.go_on(phase="asking", decision=answer.decision + 1)

    learner.on_answer = next_decision
    yield learner
    bus.close()


def said(learner: FakeLearner) -> list[tuple[int, str | None]]:
    return [(answer.decision, answer.action) for answer in learner.answers]


def test_four_lines_of_script_teach_a_session_to_its_end(
    endpoint: str, learner: FakeLearner, tmp_path: Path
) -> None:
    with join(endpoint, "s1", "ann", outbox=tmp_path / "box.sqlite") as teaching:
        for decision in teaching.decisions():
            teaching.answer(decision, action="UP")
    assert said(learner) == [(number, "UP") for number in range(DECISIONS)]


def test_a_scripted_teacher_teaches_over_the_router(endpoint: str, learner: FakeLearner) -> None:
    bus = open_bus(endpoint, 5000)
    try:
        run(ScriptedConfig("s1"), bus, lambda: None, threading.Event())
    finally:
        bus.close()
    assert said(learner) == [(number, "LEFT") for number in range(DECISIONS)]


def test_without_a_router_joining_is_one_line_with_the_mend() -> None:
    with pytest.raises(BusError, match="no router at"), join(free_endpoint(), "s1", "ann", connect_ms=0):
        pass
