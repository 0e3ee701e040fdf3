"""What every service process shares: logging, signals, and the line to its supervisor.

A supervised process inherits one end of a socket pair. It writes one JSON line when it is ready; when the
other end closes, the supervisor is gone and the process drains and leaves, so that no orphan stays behind.
"""

import gc
import json
import logging
import os
import socket
import threading
from contextlib import suppress
from dataclasses import dataclass

from services.runtime.log_config import configure
from services.runtime.signals import StopSignals

GC_THRESHOLD = (50_000, 20, 100)
"""Messages are freed by reference counts; the default of 700 scans the heap every few of them in vain."""
DRAIN_MAX_S = 10.0
"""A process that has not drained by then is ended: something hangs that no patience mends."""


@dataclass(frozen=True, slots=True)
class ProcessConfig:
    """How a service process runs."""

    role: str
    supervised_fd: int | None = None
    verbose: bool = False


class ServiceProcess:
    """Signals and supervision of one service process.

    `stop` is set by SIGTERM, SIGINT or the loss of the supervisor; a second signal ends the process at once.
    """

    def __init__(self, config: ProcessConfig) -> None:
        self.stop = threading.Event()
        self._line = None if config.supervised_fd is None else socket.socket(fileno=config.supervised_fd)
        configure(config.role, verbose=config.verbose)
        self._signals = StopSignals(self._begin_stop)
        if self._line is not None:
            threading.Thread(
                target=self._watch_supervisor, args=(self._line,), name="supervisor", daemon=True
            ).start()

    def ready(self, detail: str = "") -> None:
        """Tell the supervisor that the service can be used; `detail` is for people (where to watch, say)."""
        gc.collect()
        gc.freeze()
        gc.set_threshold(*GC_THRESHOLD)
        logging.getLogger("sfid").info("ready%s", f": {detail}" if detail else "")
        if self._line is not None:
            with suppress(OSError):  # the supervisor is gone; `_watch_supervisor` sees to that
                self._line.sendall(json.dumps({"ready": detail}).encode() + b"\n")

    def _begin_stop(self) -> None:
        if self.stop.is_set():
            return
        self.stop.set()
        watchdog = threading.Timer(DRAIN_MAX_S, os._exit, (70,))
        watchdog.daemon = True
        watchdog.start()

    def _watch_supervisor(self, line: socket.socket) -> None:
        try:
            while line.recv(64):
                pass
        except OSError:
            pass
        self._begin_stop()
