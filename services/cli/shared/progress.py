"""How far a long run is, on stderr alone: a bar at a terminal, a line now and then in a log or a pipe."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

LINE_EVERY_S = 5.0


class Lines:
    """Tells in lines how much is done, at most one in `every_s` seconds; any thread may tell or ask.

    Args: what: is counted; clock: seconds that only grow; stream: in place of stderr.
    """

    def __init__(
        self, what: str, clock: Callable[[], float], every_s: float, stream: TextIO | None = None
    ) -> None:
        self._what, self._clock, self._every_s, self._stream = what, clock, every_s, stream
        self._lock = threading.Lock()
        self._done = self._total = 0
        self._began = self._last = clock()

    def __call__(self, done: int, total: int) -> None:
        """Note that so many of `total` are done, and say so where a line is due."""
        with self._lock:
            self._done, self._total = done, total
            self._say()

    def beat(self) -> None:
        """Say how it stands where a line is due, although nothing more is done yet."""
        with self._lock:
            self._say()

    def _say(self) -> None:
        now = self._clock()
        if now - self._last < self._every_s or 0 < self._total == self._done:
            return
        self._last, passed_s = now, now - self._began
        of = f"{self._done:,} of {self._total:,}" if self._total else "begun"
        left_s = passed_s / self._done * (self._total - self._done) if self._done else None
        when = f"{passed_s:,.0f} s so far" if left_s is None else f"about {left_s:,.0f} s left"
        print(f"{self._what}: {of}, {when}", file=self._stream or sys.stderr, flush=True)


@contextmanager
def progress(what: str) -> Iterator[Any]:
    """Yield a function that shows how much is done, on stderr alone: a bar, or lines."""
    console = Console(stderr=True)
    if not console.is_terminal:
        with _beaten(Lines(what, time.monotonic, LINE_EVERY_S)) as lines:
            yield lines
        return
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as shown:
        task = shown.add_task(what)
        yield lambda done, total: shown.update(task, completed=done, total=total)


@contextmanager
def _beaten(lines: Lines) -> Iterator[Lines]:
    """Let a thread ask for a line now and then: one piece of the work may take minutes."""
    over = threading.Event()

    def beat() -> None:
        while not over.wait(LINE_EVERY_S):
            lines.beat()

    thread = threading.Thread(target=beat, name="progress", daemon=True)
    thread.start()
    try:
        yield lines
    finally:
        over.set()
        thread.join()
