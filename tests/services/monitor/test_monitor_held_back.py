"""Sessions that wait for their teachers, beside others: what viewers get of them, and when."""

from collections.abc import Iterator
from typing import cast

import msgspec

from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import (
    CreateSession,
    Decision,
    Episode,
    LabelTotals,
    SessionReport,
    SessionSummary,
    Step,
    WindowSpec,
    World,
)
from services.monitor.config import MonitorConfig
from services.monitor.live import Live
from services.monitor.rows import Document, Events, Row, Rows
from services.monitor.session_view import SessionView
from services.monitor.status import open_markdown
from services.monitor.worker import Worker
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.monitor.feeder import ROOM, Lesson
from tests.services.monitor.test_monitor_first_view import asking, waiting

ROUND_NS = 50_000_000
Message = Decision | Step | Episode


class Screen:
    """Stands where viewers are, and notes every row by recording."""

    pace = 1
    cut = 0

    def __init__(self) -> None:
        self.rows: dict[str, list[Row]] = {}

    def show(self, recording_id: str, rows: Rows) -> None:
        self.rows.setdefault(recording_id, []).extend((*rows.scene, *rows.curves))

    def forget(self, recording_id: str) -> None:
        """Nothing to close."""


def told(
    screen: Screen, *messages: Message, rounds_each: int = 8, config: MonitorConfig | None = None
) -> list[str]:
    """Say the messages, each in many rounds; return the recordings there were before the end."""
    clock, hub, keys = ManualClock(), MemoryHub(inline=True), Keys()
    bus = MemoryBus(hub)
    worker = Worker(config or MonitorConfig(), MemoryBus(hub), cast("Live", screen), clock)
    worker.subscribe()
    before: list[str] = []

    def rounds() -> Iterator[bool]:
        for message in messages:
            topic = keys.decision if isinstance(message, Decision) else keys.measures
            for _ in range(rounds_each):  # said again it changes nothing, and no round waits for a message
                bus.publish(topic(message.session), encode(message))
                clock.advance(ROUND_NS)
                yield False
        before.extend(screen.rows)
        yield True

    worker.run(rounds().__next__)
    return before


def events_of(screen: Screen, recording_id: str) -> list[str]:
    rows = [row for row in screen.rows[recording_id] if isinstance(row, Events)]
    return [text for row in rows for text in row.texts]


def steps_and_episodes(session: str) -> tuple[Message, ...]:
    messages = Lesson(session=session, episodes=1).messages()
    return tuple(each for each in messages if not isinstance(each, Decision))


def test_a_session_that_waited_for_long_is_shown_from_its_first_event_on() -> None:
    screen = Screen()
    begun = msgspec.structs.replace(asking("later"), sequence=2)
    told(screen, asking("busy"), waiting("later"), begun, rounds_each=300)
    assert events_of(screen, "local-later")[0] == "watching: sfid, 30 episodes, now waiting for teachers"


def test_a_session_that_waits_is_shown_once_the_others_are_finished() -> None:
    first, *_, last = Lesson(session="over", episodes=1).messages()
    over = cast("tuple[Decision, ...]", (first, last))
    assert told(Screen(), *over, waiting("next")) == ["local-over", "local-next"]


def test_the_end_of_the_monitor_shows_no_session_that_was_held_back() -> None:
    screen = Screen()
    assert told(screen, asking("busy"), waiting("later")) == ["local-busy"]
    assert list(screen.rows) == ["local-busy"]


def test_what_was_held_back_comes_in_its_order_and_before_what_is_new() -> None:
    screen = Screen()
    second = msgspec.structs.replace(waiting("later"), sequence=1, teachers_present=1)
    begun = msgspec.structs.replace(asking("later"), sequence=2)
    told(screen, asking("busy"), waiting("later"), second, begun, rounds_each=30)
    texts = [row.markdown for row in screen.rows["local-later"] if isinstance(row, Document)]
    assert ["waiting for teachers" in text for text in texts[:3]] == [True, True, False]
    assert ["1 present" in text for text in texts[:2]] == [False, True]


def test_a_session_with_a_past_has_begun_even_while_it_waits() -> None:
    step, *_, episode = steps_and_episodes("later")
    for message in (step, episode):
        view = SessionView(0.0, past=True)
        view.take(waiting("later"), 0.0)
        assert not view.has_begun
        view.retell(message)
        assert view.has_begun


def test_a_session_whose_rows_cannot_be_read_has_begun_when_its_report_or_decision_says_so() -> None:
    fresh = reported("later", "gathering")
    *_, episode = steps_and_episodes("later")
    later = msgspec.structs.replace(fresh.summary, decision=3)
    for report, begun in (
        (fresh, False),
        (msgspec.structs.replace(fresh, episodes=(cast("Episode", episode),)), True),
        (msgspec.structs.replace(fresh, summary=later), True),
    ):
        view = SessionView(0.0)
        view.take(waiting("later"), 0.0)
        view.take_report(report)
        view.recent.clear()
        assert view.has_begun is begun
    view = SessionView(0.0)
    view.take(msgspec.structs.replace(waiting("later"), decision=3), 0.0)
    assert view.has_begun


def test_a_session_that_goes_on_after_rows_that_cannot_be_read_is_shown_beside_another() -> None:
    damaged = msgspec.structs.replace(waiting("later"), decision=3)
    assert told(Screen(), asking("busy"), damaged) == ["local-busy", "local-later"]


def test_a_session_nobody_has_heard_of_has_not_begun() -> None:
    assert not SessionView(0.0).has_begun


def reported(session: str, phase: str) -> SessionReport:
    summary = SessionSummary(
        session=session, method="sfid", level_name="room", phase=phase, paused=False, episode=0, episodes=30,
        decision=0, teachers=(),
    )  # fmt: skip
    config = CreateSession(
        session=session, world=World(level=ROOM), window=WindowSpec(mode="early", span_ms=1)
    )
    labels = LabelTotals(
        submitted=0, acknowledged=0, applied=0, superseded=0, late=0, rejected=0, pending=0
    )  # fmt: skip
    return SessionReport(
        summary=summary, config=config, epoch=1, labels=labels, teaching_ns=0, q_sha256="", first_episode=0,
        episodes=(),
    )  # fmt: skip


def test_a_session_that_waits_shows_its_level_though_its_decision_has_no_view() -> None:
    view = SessionView(0.0)
    view.take(waiting("later"), 0.0)
    view.take_report(reported("later", "gathering"))
    assert view.view == ROOM
    assert [picture.entity for picture in view.tick(10.0).live.scene] == ["world", "policy"]


def test_a_session_known_by_its_report_alone_says_how_to_teach_it() -> None:
    assert "`sfid teach keyboard --session later`" in open_markdown(
        None, reported("later", "gathering"), None, 0.0
    )
    assert "sfid teach" not in open_markdown(None, reported("over", "finished"), None, 0.0)


def test_the_session_of_a_deployment_elsewhere_is_taught_by_a_command_that_reaches_it() -> None:
    screen = Screen()
    teach = "`sfid teach keyboard --session {session} --connect tcp/10.0.0.1:7447`"
    told(screen, waiting("later"), config=MonitorConfig(teach=teach))
    command = "teach it: `sfid teach keyboard --session later --connect tcp/10.0.0.1:7447`"
    texts = [row.markdown for row in screen.rows["local-later"] if isinstance(row, Document)]
    assert command in texts[-1]
    assert command in open_markdown(None, reported("later", "gathering"), None, 0.0, teach)


def test_a_report_that_comes_late_does_not_put_the_first_board_over_the_present_one() -> None:
    view = SessionView(0.0)
    view.take(msgspec.structs.replace(asking("busy"), view="#####\n#@$.#\n#####"), 0.0)
    view.take_report(reported("busy", "asking"))
    assert view.view == "#####\n#@$.#\n#####"


def test_a_session_is_finished_when_its_report_alone_says_so() -> None:
    view = SessionView(0.0)
    assert not view.is_finished
    view.take_report(reported("over", "finished"))
    assert view.is_finished
