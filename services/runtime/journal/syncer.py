"""A thread that syncs a file while its caller does something else."""

from __future__ import annotations

import os
import queue
import threading
from enum import Enum, auto


class _Task(Enum):
    SYNC = auto()
    END = auto()


class Syncer:
    """Runs `fdatasync` on one open file beside its caller, one sync at a time.

    Kept alive between syncs, because starting a thread costs as much as a sync of a fast disk.
    """

    def __init__(self, fd: int) -> None:
        """Serve the file `fd`, which stays open until `close` returned."""
        self._asked: queue.SimpleQueue[_Task] = queue.SimpleQueue()
        self._done: queue.SimpleQueue[OSError | None] = queue.SimpleQueue()
        # Daemon: a process that ends without closing must not wait for a thread nobody will ask again.
        self._thread = threading.Thread(
            target=_serve, args=(fd, self._asked, self._done), name="journal-sync", daemon=True
        )
        self._thread.start()

    def start(self) -> None:
        """Begin a sync; `wait` comes before the next one."""
        self._asked.put(_Task.SYNC)

    def wait(self) -> None:
        """Return when the sync that was begun is done; raise its OSError."""
        error = self._done.get()
        if error is not None:
            raise error

    def close(self) -> None:
        """End the thread after the sync it is in; safe to call twice."""
        self._asked.put(_Task.END)
        self._thread.join()


def _serve(fd: int, asked: queue.SimpleQueue[_Task], done: queue.SimpleQueue[OSError | None]) -> None:
    while asked.get() is _Task.SYNC:
        try:
            os.fdatasync(fd)
        except OSError as error:
            done.put(error)
        else:
            done.put(None)
