"""Which session a viewer opens first: it opens the one that was shown last."""

from collections.abc import Iterator
from typing import cast

import msgspec

from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Decision
from services.monitor.config import MonitorConfig
from services.monitor.live import Live
from services.monitor.rows import Document, Rows
from services.monitor.status import NOW, PHASES, open_markdown
from services.monitor.worker import Worker
from services.runtime.clock import ManualClock
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.monitor.feeder import Lesson

ROUND_NS = 600_000_000
"""Longer than the period of every text."""


class Screen:
    """Stands where viewers are, and notes which recordings there are, in order."""

    pace = 1
    cut = 0

    def __init__(self) -> None:
        self.recordings: dict[str, list[str]] = {}
        """What "Now" said, by recording."""

    def show(self, recording_id: str, rows: Rows) -> None:
        texts = self.recordings.setdefault(recording_id, [])
        texts += [row.markdown for row in rows.curves if isinstance(row, Document) and row.entity == NOW]

    def forget(self, recording_id: str) -> None:
        """Nothing to close."""


def asking(session: str) -> Decision:
    return next(each for each in Lesson(session=session).messages() if isinstance(each, Decision))


def waiting(session: str) -> Decision:
    return msgspec.structs.replace(asking(session), phase="gathering", view="", sequence=0)


def shown(*decisions: Decision) -> dict[str, list[str]]:
    """Return what viewers have when the decisions were said one after the other."""
    screen, clock, hub = Screen(), ManualClock(), MemoryHub(inline=True)
    bus, keys = MemoryBus(hub), Keys()
    worker = Worker(MonitorConfig(), MemoryBus(hub), cast("Live", screen), clock)
    worker.subscribe()
    said: list[dict[str, list[str]]] = []

    def rounds() -> Iterator[bool]:
        for decision in decisions:
            bus.publish(keys.decision(decision.session), encode(decision))
            yield False
            for _ in range(8):
                clock.advance(ROUND_NS)
                yield False
        said.append({name: list(texts) for name, texts in screen.recordings.items()})
        yield True

    worker.run(rounds().__next__)
    return said[0]


def test_a_session_that_waits_for_its_teachers_comes_behind_one_where_something_happens() -> None:
    assert list(shown(asking("busy"), waiting("later"))) == ["local-busy"]
    assert list(shown(waiting("later"), asking("busy"))) == ["local-later", "local-busy"]


def test_a_session_that_waits_is_shown_when_there_is_no_other() -> None:
    assert list(shown(waiting("later"))) == ["local-later"]


def test_what_was_held_back_of_a_session_is_shown_once_it_begins() -> None:
    texts = shown(asking("busy"), waiting("later"), asking("later"))["local-later"]
    assert "waiting for teachers" in texts[0]
    assert "asking the teachers" in texts[-1]


def test_a_session_that_waits_says_how_to_teach_it() -> None:
    assert "`sfid teach keyboard --session later`" in open_markdown(waiting("later"), None, None, 0.0)
    assert "sfid teach" not in open_markdown(asking("busy"), None, 1.0, 0.0)


def test_how_to_teach_it_is_said_of_sessions_that_wait_whether_they_have_a_view_or_not() -> None:
    board = asking("busy").view
    assert board
    for phase, view in ((phase, view) for phase in PHASES for view in ("", board)):
        decision = msgspec.structs.replace(asking("s"), phase=phase, view=view)
        assert ("sfid teach" in open_markdown(decision, None, 1.0, 0.0)) == (phase == "gathering")
