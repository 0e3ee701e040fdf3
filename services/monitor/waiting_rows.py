"""Rows on their way to viewers: a queue that never holds its writer up, and forgets the oldest instead."""

import threading
from collections import deque

from services.monitor.rows import Row

ROWS_WAITING_MAX = 1024


class WaitingRows:
    """A bounded queue of (recording, row) between two threads; (recording, None) is a recording's end."""

    def __init__(self, rows_max: int = ROWS_WAITING_MAX) -> None:
        self.dropped = 0
        """Rows that gave way to newer ones."""
        self._rows_max = rows_max
        self._rows: deque[tuple[str, Row | None]] = deque()
        self._changed = threading.Condition()
        self._closed = False

    def put(self, recording_id: str, *rows: Row | None) -> None:
        """Add rows; never waits."""
        with self._changed:
            for row in rows:
                if len(self._rows) >= self._rows_max:
                    self._drop_oldest()
                self._rows.append((recording_id, row))
            self._changed.notify()

    def _drop_oldest(self) -> None:
        # Never an end: the recording's streams, two threads each, would stay for ever.
        oldest = next((at for at, (_, row) in enumerate(self._rows) if row is not None), None)
        if oldest is not None:
            del self._rows[oldest]
            self.dropped += 1

    def take(self) -> tuple[str, Row | None] | None:
        """Return the oldest, waiting for one if need be; None once all are taken after `close`."""
        with self._changed:
            self._changed.wait_for(lambda: self._rows or self._closed)
            return self._rows.popleft() if self._rows else None

    def close(self) -> None:
        """Let `take` end when nothing is left."""
        with self._changed:
            self._closed = True
            self._changed.notify()
