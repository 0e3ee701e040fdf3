"""Rows on their way to viewers: a queue that never holds its writer up, and forgets the oldest instead."""

import threading
from collections import deque

from services.monitor.rows import Curves, Document, Events, Lane, Picture, Reliabilities, Row

ROWS_WAITING_MAX = 1024
BYTES_WAITING_MAX = 32 << 20
"""Pictures are raw, 20 to 53 kB of a usual level, and grow with it. The 600 of the past that a late start
shows at once (`session_view.PAST_PICTURES_MAX`) fit."""
ROW_BYTES = 512
"""Taken for whatever a row is made of beside its contents."""
MOMENT_BYTES = 128


class WaitingRows:
    """A queue of (recording, row) between two threads; (recording, None) is a recording's end.

    Args: rows_max, bytes_max: what it holds at most; a single row may be larger, and then waits alone.
    """

    def __init__(self, rows_max: int = ROWS_WAITING_MAX, bytes_max: int = BYTES_WAITING_MAX) -> None:
        self.dropped = 0
        """Rows that gave way to newer ones."""
        self._rows_max, self._bytes_max = rows_max, bytes_max
        self._rows: deque[tuple[str, Row | None]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._closed = False

    def put(self, recording_id: str, *rows: Row | None) -> None:
        """Add rows; never waits."""
        with self._changed:
            for row in rows:
                size = size_of(row)
                while len(self._rows) >= self._rows_max or self._bytes + size > self._bytes_max:
                    if not self._drop_oldest():
                        break
                self._rows.append((recording_id, row))
                self._bytes += size
            self._changed.notify()

    def _drop_oldest(self) -> bool:
        # Never an end: the recording's streams, two threads each, would stay for ever.
        for at, (_, row) in enumerate(self._rows):
            if row is not None:
                del self._rows[at]
                self._bytes -= size_of(row)
                self.dropped += 1
                return True
        return False

    def take(self) -> tuple[str, Row | None] | None:
        """Return the oldest, waiting for one if need be; None once all are taken after `close`."""
        with self._changed:
            self._changed.wait_for(lambda: self._rows or self._closed)
            if not self._rows:
                return None
            item = self._rows.popleft()
            self._bytes -= size_of(item[1])
            return item

    def close(self) -> None:
        """Let `take` end when nothing is left."""
        with self._changed:
            self._closed = True
            self._changed.notify()


def size_of(row: Row | None) -> int:
    """Return about how many bytes a row holds; palettes are shared by all, and count nothing."""
    return 0 if row is None else ROW_BYTES + _contents(row)


def _contents(row: Row) -> int:
    match row:
        case Picture():
            picture = len(row.image) if isinstance(row.image, bytes) else row.image.indexes.nbytes
            return picture + MOMENT_BYTES * (len(row.arrows) + len(row.lanes))
        case Document():
            return len(row.markdown)
        case Curves():
            return row.values.nbytes + MOMENT_BYTES * len(row.moments)
        case Events():
            return sum(map(len, row.texts)) + MOMENT_BYTES * len(row.moments)
        case Lane() | Reliabilities():
            return MOMENT_BYTES * len(row.moments)
