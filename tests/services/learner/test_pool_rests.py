"""When a process of a pool keeps its hands off a shard: its learner failed there, or no router is reached."""

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import pytest

from protocol.keys import Keys
from services.learner.config import LearnerConfig
from services.learner.ownership import agree_on_shards
from services.learner.pool import Pool
from services.learner.vigil import FAILED_MS
from services.runtime.clock import ManualClock
from services.runtime.journal import shard_directory
from services.runtime.journal.lock import is_owned
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.cli.command_line import wait_for

MS = 1_000_000
DEADLINE_S = 30.0
KEYS = Keys("local")
TAKEOVER_MS, SETTLE_MS, JITTER_MS = 100, 5_000, 20


class Line(MemoryBus):
    """A bus of whose connection the test tells; it counts the looks at it, and may fail a learner."""

    def __init__(self, *, reachable: bool = True, failing: str = "") -> None:
        super().__init__(MemoryHub(inline=True))
        self.reachable, self.failing = reachable, failing
        self.looks = 0
        self.tell: Callable[[bool], None] = lambda _connected: None

    def connected(self) -> bool:
        self.looks += 1
        return self.reachable

    def on_connection(self, receive: Callable[[bool], None]) -> None:
        self.tell = receive
        receive(self.reachable)

    def announce(self, key: str) -> Callable[[], None]:
        if key == self.failing:
            self.failing = ""
            message = "what nobody thought of"
            raise RuntimeError(message)
        return super().announce(key)

    @property
    def holds(self) -> set[int]:
        return {int(token.rpartition("-")[2]) for token in tuple(self.tokens) if "/shard-" in token}

    def look_on(self) -> None:
        """Wait until the pool has looked at the connection again, or taken a shard."""
        seen = self.looks
        wait_for("it looks", lambda: self.looks >= seen + 3 or bool(self.holds))


@contextmanager
def running(data_dir: Path, shards: int, home: int | None, line: Line) -> Iterator[ManualClock]:
    """Run a process of the pool under a clock that stands still."""
    clock, ready, stop = ManualClock(wall_ns=1_700_000_000_000_000_000), threading.Event(), threading.Event()
    config = LearnerConfig(
        data_dir, shards=shards, takeover_ms=TAKEOVER_MS, settle_ms=SETTLE_MS, burden_ms=0,
        jitter_ms=JITTER_MS, cut_off_ms=300,
    )  # fmt: skip
    agree_on_shards(data_dir, shards)
    pool = Pool(config, home, line, clock, chance=Random(1))
    thread = threading.Thread(target=pool.run, args=(ready.set, stop), daemon=True)
    thread.start()
    try:
        assert ready.wait(DEADLINE_S)
        yield clock
    finally:
        stop.set()
        thread.join(DEADLINE_S)
        assert not thread.is_alive()


def test_a_shard_whose_learner_failed_rests_while_others_are_taken_and_the_log_says_why(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    line = Line(failing=KEYS.service("learner", "shard-0"))
    with running(tmp_path / "data", 2, 0, line) as clock:
        errors = [record for record in caplog.records if record.levelno >= logging.ERROR]
        said = [(record.levelno, record.getMessage()) for record in errors]
        assert said == [
            (logging.ERROR, "shard 0: its learner failed"),
            (
                logging.ERROR,
                "shard 0 has no learner here, the others go on: RuntimeError: what nobody thought of",
            ),
        ]
        assert errors[0].exc_info is not None
        # Of two that are due, the one that has been free for longer is taken first: that would be shard 0.
        clock.advance((SETTLE_MS + JITTER_MS) * MS)
        wait_for("it has the other", lambda: 1 in line.holds)
        assert line.holds == {1}
        clock.advance((FAILED_MS - SETTLE_MS) * MS)
        wait_for("it tries again", lambda: line.holds == {0, 1})


def test_who_reaches_no_router_takes_nothing_and_then_waits_for_others_to_be_seen(tmp_path: Path) -> None:
    line = Line(reachable=False)
    with running(tmp_path / "data", 1, None, line) as clock:
        clock.advance(60_000 * MS)
        line.look_on()
        assert line.holds == set()
        line.tell(True)  # noqa: FBT003 - as a bus calls it
        line.look_on()  # it has heard that by now
        line.reachable = True
        line.look_on()
        assert line.holds == set()
        assert not is_owned(shard_directory(tmp_path / "data", 0))
        clock.advance((TAKEOVER_MS + JITTER_MS) * MS)
        wait_for("it has it", lambda: line.holds == {0})


def test_the_home_shard_too_is_taken_only_where_a_router_is_reached(tmp_path: Path) -> None:
    line = Line(reachable=False)
    data_dir, started = tmp_path / "data", threading.Event()
    stop, clock = threading.Event(), ManualClock()
    config = LearnerConfig(data_dir, takeover_ms=TAKEOVER_MS, jitter_ms=0)
    thread = threading.Thread(target=Pool(config, 0, line, clock).run, args=(started.set, stop), daemon=True)
    thread.start()
    line.look_on()
    held, early = line.holds, started.is_set()
    line.reachable = True
    line.tell(True)  # noqa: FBT003 - as a bus calls it
    line.look_on()
    clock.advance(TAKEOVER_MS * MS)
    ready = started.wait(DEADLINE_S)
    stop.set()
    thread.join(DEADLINE_S)
    assert (held, early, ready, thread.is_alive()) == (set(), False, True, False)
