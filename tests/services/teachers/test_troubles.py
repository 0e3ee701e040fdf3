"""What a simulated teacher's log says while it waits, and what it says at the end."""

import threading
from functools import partial

import pytest

from protocol.messages import Refusal, SessionList, SessionSummary
from services.cli.session_hint import hint_of
from services.cli.shared.next_command import suggested
from services.client import AnswerState, AnswerUpdate, Connection, Refused
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from services.teachers.crowd import CrowdConfig, run
from services.teachers.troubles import PATIENCE_NS, Troubles
from sfid_core.teaching.crowd_mix import parse_mix
from tests.services.teachers.fake_learner import FakeLearner

NOT_HERE = Refused("unknown-session", "no session s1 here", final=False)


def test_who_waits_says_for_what_at_once_and_what_helps_after_a_time(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock, asked = ManualClock(), []

    def hint() -> str:
        asked.append(clock.now_ns())
        return "there are s2: name one of them"

    troubles = Troubles("s1", clock, hint)
    with caplog.at_level("INFO", "sfid.teacher"):
        troubles.note(NOT_HERE, "w1")
        troubles.note(Connection(connected=False, detail="no learner answers"), "w2")
        clock.advance(PATIENCE_NS - 1)
        troubles.note(None)
        clock.advance(1)
        troubles.note(None)
        clock.advance(PATIENCE_NS)
        troubles.note(NOT_HERE, "w1")
        troubles.end(0, 0, 0, 0)
    assert caplog.messages == [
        "session s1: waiting, no session s1 here",
        "session s1: nothing to teach for 10 s: there are s2: name one of them",
        "session s1: left without having joined: no session s1 here",
    ]
    assert asked == [PATIENCE_NS]


def test_who_finds_the_name_taken_is_told_the_mend_and_nothing_beside_it(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock = ManualClock()
    troubles = Troubles("s1", clock, lambda: "asked in vain")
    with caplog.at_level("INFO", "sfid.teacher"):
        troubles.note(Refused("conflict", "somebody teaches s1 as ann already", final=False))
        clock.advance(PATIENCE_NS)
        troubles.note(None)
        troubles.end(0, 0, 0, 0)
    assert caplog.messages == [
        "session s1: waiting, somebody teaches s1 as ann already",
        "session s1: left without having joined: somebody teaches s1 as ann already",
    ]


def test_who_finds_the_name_taken_after_another_trouble_is_told_it_once_and_of_troubles_that_come_later(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock = ManualClock()
    troubles = Troubles("s1", clock, lambda: "start it")
    taken = Refused("conflict", "somebody teaches s1 as ann already", final=False)
    gone = Connection(connected=False, detail="no learner answers")
    with caplog.at_level("INFO", "sfid.teacher"):
        for update in (gone, taken, gone, taken):
            troubles.note(update)
        clock.advance(PATIENCE_NS)
        troubles.note(None)
        told = list(caplog.messages)
        troubles.note(gone)
    assert told == [
        "session s1: waiting, no learner answers",
        "session s1: waiting, somebody teaches s1 as ann already",
    ]
    assert caplog.messages[2:] == ["session s1: nothing to teach for 10 s: start it"]


def test_the_time_for_which_the_mend_was_known_is_none_in_which_help_was_wanted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock = ManualClock()
    troubles = Troubles("s1", clock, lambda: "start it")
    for _ in range(100):
        troubles.note(Refused("conflict", "somebody teaches s1 as ann already", final=False))
        clock.advance(PATIENCE_NS // 2)
    hints = []
    for _ in range(2):
        troubles.note(Connection(connected=False, detail="no learner answers"))
        hints.append("start it" in caplog.text)
        clock.advance(PATIENCE_NS // 2)
    assert hints == [False, True]


def test_an_answer_that_is_sent_again_and_again_is_told_at_each_doubling(
    caplog: pytest.LogCaptureFixture,
) -> None:
    troubles = Troubles("s1", ManualClock())
    for attempts in range(1, 9):
        troubles.note(AnswerUpdate(b"", AnswerState.RETRYING, attempts=attempts, reason="busy"))
    assert caplog.messages == [f"session s1: answer sent {count} times: busy" for count in (2, 4, 8)]


def test_a_crowd_says_whom_it_waits_for_and_what_its_answers_came_to(
    caplog: pytest.LogCaptureFixture,
) -> None:
    hub = MemoryHub(inline=True)
    learner = FakeLearner(MemoryBus(hub))
    learner.join_refusal = Refusal(code="unknown-session", reason="no session s1 here")

    def let_in(joins: int) -> None:
        if joins == 3:
            learner.join_refusal = None

    def finish(_answer: object) -> None:
        if len(learner.answers) == 2:
            learner.go_on(phase="finished")

    learner.on_join, learner.on_answer = let_in, finish
    config = CrowdConfig("s1", parse_mix("expert:2"), deployment="local")
    with caplog.at_level("INFO", "sfid.teacher"):
        run(config, MemoryBus(hub), lambda: None, threading.Event())
    assert caplog.messages == [
        "session s1: waiting, no session s1 here",
        "session s1: joined",
        "session s1: 2 answers saved",
    ]


def test_a_crowd_told_to_stop_before_its_session_came_says_so(caplog: pytest.LogCaptureFixture) -> None:
    stop = threading.Event()
    stop.set()
    results = run(
        CrowdConfig("s1", parse_mix("expert:1")), MemoryBus(MemoryHub(inline=True)), lambda: None, stop
    )
    assert [one.accepted for one in results] == [0]
    assert caplog.messages == ["session s1: left without having joined: nothing was heard of it"]


def listed(*names: str, shards: int = 1) -> SessionList:
    """What the learner of the first of so many shards lists, alone."""
    rows = [
        SessionSummary(
            session=name, method="sfid", level_name="room", phase="asking", paused=False,
            episode=0, episodes=30, decision=0, teachers=(),
        )
        for name in names
    ]  # fmt: skip
    return SessionList(sessions=tuple(rows), shards=shards)


def test_who_cannot_ask_all_shards_is_not_told_that_a_session_is_absent() -> None:
    said = hint_of("s1", listed("a", shards=2), suggested, crowd=False)
    assert said.startswith(
        "the list is not whole: shard-1 of 2 shards did not answer to the end; `sfid status`"
    )
    assert hint_of("a", listed("a", shards=2), suggested, crowd=False).startswith("the session is there")


def test_the_hint_names_what_there_is_and_the_mend() -> None:
    many = [f"t{number}" for number in range(12)]
    create = "`sfid session create s1 --connect tcp/127.0.0.1:7001 --deployment lab`"
    at = partial(suggested, connect="tcp/127.0.0.1:7001", deployment="lab")
    assert hint_of("s1", listed(), at, crowd=False) == f"there is no session at all: {create} creates it"
    assert hint_of("s1", listed("a", "b"), at, crowd=True) == (
        f"there are a, b: name one of them with --session, or {create} creates this one"
    )
    assert hint_of("s1", listed(*many), at, crowd=False).startswith(
        f"there are {', '.join(many[2:])} and 2 more: "
    )
    flags = "--connect tcp/127.0.0.1:7001 --deployment lab"
    assert hint_of("s1", listed("s1"), at, crowd=True) == (
        f"the session is there: see in `sfid status {flags}` whether the aggregator, "
        "which comes with --crowd of `sfid up`, is well"
    )
    assert hint_of("s1", listed("s1"), suggested, crowd=False) == (
        "the session is there: see in `sfid status` whether the learner is well"
    )
