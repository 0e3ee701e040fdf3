"""Starts a set of service processes, restarts what dies, and takes everything down in order."""

import json
import logging
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from services.runtime.signals import Stop, heard_by_children

log = logging.getLogger("sfid.supervisor")

READY_TIMEOUT_S = 60.0
"""Importing the viewer's library on a busy machine takes seconds; a minute is a hang."""
DRAIN_TIMEOUT_S = 12.0
"""Longer than a service's own watchdog, so that it has the first word."""
RESTARTS_MAX = 8
RESTARTS_WINDOW_S = 60.0
"""More restarts than that within the window: the service cannot live here, and trying on would hide it."""
POLL_S = 0.05


class SupervisorError(Exception):
    """A service cannot start or stay alive; the text is one line, the exit code that of the service."""

    def __init__(self, message: str, exit_code: int = 1) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class _UnwantedError(Exception):
    """Nobody waits any more for what is being started."""


@dataclass(frozen=True, slots=True)
class Service:
    """One process to run: its name in logs and the arguments of `sfid`."""

    name: str
    arguments: tuple[str, ...]
    lasting: bool = True
    """Whether it is restarted when it ends by itself with exit code 0 (a teacher's work may be done)."""


@dataclass(slots=True)
class _Running:
    service: Service
    process: subprocess.Popen[bytes]
    line: socket.socket
    detail: str = ""
    started: list[float] = field(default_factory=list)


class Supervisor:
    """Runs services as child processes; a thread of its own watches them.

    Args: log_dir: where each service's log goes (`<name>.log`), None for this process's own stderr;
    changed: called with the running processes after every start; wanted_no_more: when it is set, nothing is
    waited for until it is ready.
    """

    def __init__(
        self,
        log_dir: Path | None,
        changed: Callable[[list[tuple[str, int]]], None] | None = None,
        wanted_no_more: Stop | None = None,
    ) -> None:
        self._log_dir = log_dir
        self._changed = changed
        self._running: dict[str, _Running] = {}
        self._ended: list[tuple[str, int]] = []
        self._lock = threading.RLock()
        self._stopping = threading.Event()
        self._wanted_no_more = wanted_no_more or Stop()
        self._failure: SupervisorError | None = None
        self._watcher = threading.Thread(target=self._watch, name="watch-services", daemon=True)
        self._watcher.start()

    def start(self, *services: Service) -> dict[str, str]:
        """Start services side by side and wait until all are ready; return their details by name.

        Raises: SupervisorError when one ends before it is ready; its own line has then been printed.
        KeyboardInterrupt when they are wanted no more; they have ended then.
        """
        with self._lock:
            spawned: list[_Running] = []
            try:
                for service in services:
                    spawned.append(self._spawn(service, []))  # noqa: PERF401 - those before a failure must be known
                for running in spawned:
                    self._await_ready(running)
            except BaseException as error:  # who was started together ends together
                for running in spawned:
                    self._end(running)
                if isinstance(error, _UnwantedError):
                    raise KeyboardInterrupt from None
                raise
            self._running.update({running.service.name: running for running in spawned})
            self._tell()
        return {running.service.name: running.detail for running in spawned}

    def processes(self) -> list[tuple[str, int]]:
        """Return (name, pid) of everything that runs, and of what ran last under its name."""
        with self._lock:
            live = [(name, running.process.pid) for name, running in self._running.items()]
        return live + [row for row in self._ended if row[0] not in dict(live)]

    def check(self) -> None:
        """Raise the SupervisorError of a service that could not be kept alive."""
        if self._failure is not None:
            raise self._failure

    def stop(self, names: Sequence[str] | None = None) -> None:
        """Drain the named services in that order (default: all, last started first)."""
        if names is None:
            self._stopping.set()
            self._watcher.join()
        for name in list(reversed(self._running)) if names is None else names:
            with self._lock:
                running = self._running.pop(name, None)
            if running is not None:
                self._end(running)

    def _end(self, running: _Running) -> None:
        process = running.process
        self._ended.append((running.service.name, process.pid))
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        try:
            process.wait(DRAIN_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            log.warning(
                "%s (pid %d) did not drain in %.0f s: killed",
                running.service.name,
                process.pid,
                DRAIN_TIMEOUT_S,
            )
            process.kill()
            process.wait()
        running.line.close()

    def _spawn(self, service: Service, started: list[float]) -> _Running:
        ours, theirs = socket.socketpair()
        command = [sys.executable, "-P", "-m", "services.cli.main", *service.arguments]
        command += ["--supervised-fd", str(theirs.fileno())]
        stderr = None if self._log_dir is None else (self._log_dir / f"{service.name}.log").open("ab")
        try:
            with heard_by_children():
                process = subprocess.Popen(
                    command, pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL, stdout=stderr,
                    stderr=stderr, start_new_session=True,
                )  # fmt: skip
        finally:
            theirs.close()
            if stderr is not None:
                stderr.close()
        return _Running(service, process, ours, started=[*started, time.monotonic()])

    def _await_ready(self, running: _Running) -> None:
        until = time.monotonic() + READY_TIMEOUT_S
        while not select.select([running.line], [], [], POLL_S)[0]:
            if self._stopping.is_set() or self._wanted_no_more.is_set():
                raise _UnwantedError
            if time.monotonic() >= until:
                running.process.kill()
        text = running.line.makefile("rb").readline()  # one line, sent whole, or the end
        if text:
            running.detail = str(json.loads(text)["ready"])
            return
        code = running.process.wait()
        running.line.close()
        raise SupervisorError(self._last_words(running.service, code), code if code > 0 else 1)

    def _last_words(self, service: Service, code: int) -> str:
        """Return the last line of a service that could not start; empty if it went to our own stderr."""
        if self._log_dir is not None:
            lines = (self._log_dir / f"{service.name}.log").read_text(errors="replace").strip().splitlines()
            if lines:
                return lines[-1].removeprefix("sfid: ")
        elif code > 0:
            return ""
        return f"{service.name} could not start (exit code {code})"

    def _watch(self) -> None:
        while not self._stopping.wait(POLL_S):
            with self._lock:
                for running in list(self._running.values()):
                    if running.process.poll() is not None:
                        self._revive(running)

    def _revive(self, running: _Running) -> None:
        """Start a service again that has ended, unless its work is done or it keeps dying."""
        name, code = running.service.name, running.process.returncode
        running.line.close()
        del self._running[name]
        if code == 0 and not running.service.lasting:
            self._ended.append((name, running.process.pid))
            return
        how = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        recent = [start for start in running.started if time.monotonic() - start < RESTARTS_WINDOW_S]
        if len(recent) > RESTARTS_MAX:
            self._failure = SupervisorError(
                f"{name} {how} and was restarted {RESTARTS_MAX} times: see its log", 1
            )
            return
        log.warning("%s (pid %d) %s: starting it again", name, running.process.pid, how)
        try:
            again = self._spawn(running.service, recent)
            try:
                self._await_ready(again)
            except _UnwantedError:
                self._end(again)
                return
        except (SupervisorError, OSError) as error:
            text = (
                str(error)
                if isinstance(error, SupervisorError)
                else f"{name} cannot be started again: {error}"
            )
            self._failure = SupervisorError(text, 1)
            return
        self._running[name] = again
        log.warning("%s runs again (pid %d)", name, again.process.pid)
        self._tell()

    def _tell(self) -> None:
        if self._changed is None:
            return
        try:
            self._changed(self.processes())
        except OSError as error:  # a full disk must not end the watch over the services
            log.warning("who runs could not be written down: %s", error)


def write_processes(path: Path, processes: list[tuple[str, int]]) -> None:
    """Write who runs under which process id, for tools and tests; replaced whole."""
    temporary = path.with_suffix(".part")
    temporary.write_text(json.dumps([{"role": name, "pid": pid} for name, pid in processes]) + "\n")
    temporary.replace(path)
