"""How often viewers are shown something: less often, the more of them there are."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack
from typing import cast

import pytest

from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Decision
from services.monitor.config import LOOPBACK, Addresses, MonitorConfig, free_port
from services.monitor.live import VIEWERS_AT_FULL_PACE, Live
from services.monitor.overview import ENTITY, PERIOD_S
from services.monitor.rows import Picture, Rows
from services.monitor.session_view import SCENE_PERIOD_S
from services.monitor.worker import Worker
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.monitor.feeder import Lesson
from tests.services.monitor.test_monitor_live import eventually

DECISION_MS = 23
DECISIONS = 500
PICTURES = DECISIONS * DECISION_MS / (SCENE_PERIOD_S * 1_000)
"""For one viewer of one session."""


HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
"""How every HTTP/2 client begins: the preface and empty settings (RFC 9113, 3.4)."""


class Screen:
    """Stands where viewers are, and counts what each would be shown."""

    def __init__(self, pace: int) -> None:
        self.pace = pace
        self.cut = 0
        self.worlds = 0
        self.overviews = 0

    def show(self, _recording_id: str, rows: Rows) -> None:
        shown = [row.entity for row in (*rows.scene, *rows.curves) if isinstance(row, Picture)]
        self.worlds += shown.count("world")
        self.overviews += shown.count(ENTITY)

    def forget(self, recording_id: str) -> None:
        """Nothing to close."""


def shown(pace: int, sessions: int = 1) -> Screen:
    """Return what was shown of some ten seconds in which every session opened forty decisions a second."""
    screen, clock, hub = Screen(pace), ManualClock(), MemoryHub(inline=True)
    bus, keys = MemoryBus(hub), Keys()
    worker = Worker(MonitorConfig(), MemoryBus(hub), cast("Live", screen), clock)
    worker.subscribe()
    lessons = [
        (message for message in Lesson(session=f"s{number}").messages() if isinstance(message, Decision))
        for number in range(sessions)
    ]

    def rounds() -> Iterator[bool]:
        for _ in range(DECISIONS):
            clock.advance(DECISION_MS * 1_000_000)
            for lesson in lessons:
                decision = next(lesson)
                bus.publish(keys.decision(decision.session), encode(decision))
            yield False
        yield True

    worker.run(rounds().__next__)
    return screen


@pytest.mark.parametrize("pace,sessions", [(1, 1), (3, 1), (1, 2), (3, 2)])
def test_viewers_and_sessions_share_one_rate_of_pictures(pace: int, sessions: int) -> None:
    alone, together = shown(1), shown(pace, sessions)
    assert 0.8 * PICTURES <= alone.worlds <= PICTURES + 5
    share = together.worlds / sessions * (pace * sessions)
    assert 0.8 * PICTURES <= share <= PICTURES + 5 * pace * sessions
    span_s = DECISIONS * DECISION_MS / 1_000
    assert alone.overviews >= span_s / PERIOD_S - 1
    assert abs(together.overviews / sessions - span_s / (PERIOD_S * pace * sessions)) <= 1


def test_beyond_four_viewers_the_pace_slows_and_comes_back_when_they_leave() -> None:
    addresses = Addresses(free_port(set()), free_port(set()), None)
    live = Live(addresses)
    try:
        assert live.pace == 1
        with ExitStack() as stack:
            for viewers, pace in ((VIEWERS_AT_FULL_PACE, 1), (1, 2), (VIEWERS_AT_FULL_PACE, 3)):
                for _ in range(viewers):
                    viewer = socket.create_connection((LOOPBACK, addresses.scene_port))
                    stack.enter_context(viewer).sendall(HELLO)
                    assert viewer.recv(1)  # the server's own settings
                eventually(lambda: live.pace == pace)  # noqa: B023 - waited for in this turn
            for _ in range(VIEWERS_AT_FULL_PACE):  # whoever says nothing is no viewer
                stack.enter_context(socket.create_connection((LOOPBACK, addresses.scene_port)))
            assert live.pace == 3
        eventually(lambda: live.pace == 1)
        assert live.cut == 0
    finally:
        assert live.close(5.0)
