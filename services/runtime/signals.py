"""SIGTERM and Ctrl-C, heard on a thread of their own so that they interrupt nothing.

A signal handler in Python runs on the main thread, inside whatever that is doing: it may want a lock that the
code below it holds, what it raises may end in a callback where nobody sees it, and a timed `SimpleQueue.get`
waits for ever when the interruption takes longer than its timeout (CPython 3.11 and 3.12). So the main thread
blocks both signals, and the thread that does not is told of them through a socket.
"""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Self

NUMBERS = (signal.SIGTERM, signal.SIGINT)
SAME_S = 0.1
"""`timeout` and process groups send a signal twice at once; nobody presses Ctrl-C again so soon."""


class StopSignals:
    """Calls `first` at the first SIGTERM or SIGINT, on its own thread; the second ends the process at once.

    Made on the main thread, before threads that are not to be interrupted; `close` puts back what was before.
    Args: same_s: a signal that comes so soon after the first belongs to it.
    """

    def __init__(self, first: Callable[[], None], same_s: float = SAME_S) -> None:
        self._first, self._same_s = first, same_s
        self._ear, self._mouth = socket.socketpair()
        self._mouth.settimeout(0)
        self._wakeup_before = signal.set_wakeup_fd(self._mouth.fileno(), warn_on_full_buffer=False)
        self._handlers_before = [(number, signal.signal(number, _say_nothing)) for number in NUMBERS]
        self._mask_before = signal.pthread_sigmask(signal.SIG_BLOCK, NUMBERS)
        self._thread = threading.Thread(target=self._listen, name="stop-signals", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the signals back to whoever had them before."""
        for number, handler in self._handlers_before:
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wakeup_before)
        self._mouth.close()
        self._thread.join()
        signal.pthread_sigmask(signal.SIG_SETMASK, self._mask_before)

    def _listen(self) -> None:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, NUMBERS)
        heard_s: float | None = None
        with self._ear:
            while said := self._ear.recv(1):
                if said[0] not in NUMBERS:
                    continue
                if heard_s is None:
                    heard_s = time.monotonic()
                    self._first()
                elif time.monotonic() - heard_s > self._same_s:
                    os._exit(128 + said[0])


class Stop(threading.Event):
    """Set when a command is no longer wanted; whatever waits in it looks at this."""

    def look(self) -> None:
        """Raise KeyboardInterrupt when set."""
        if self.is_set():
            raise KeyboardInterrupt

    def pause(self, seconds: float) -> None:
        """Wait so long; raise KeyboardInterrupt as soon as it is set."""
        self.wait(seconds)
        self.look()


@contextmanager
def heard_by_children() -> Iterator[None]:
    """Let processes that are started inside hear signals: they would inherit what this thread blocks."""
    mask = signal.pthread_sigmask(signal.SIG_UNBLOCK, NUMBERS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _say_nothing(_number: int, _frame: FrameType | None) -> None:
    """Make the interpreter write to the socket; a signal without a Python handler would end the process."""
