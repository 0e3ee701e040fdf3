"""`sfid` as a person runs it: a child process, its two outputs and its exit code."""

import atexit
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

SFID = str(Path(sys.executable).with_name("sfid"))
COMMAND_S = 60.0


class Done(NamedTuple):
    """How a command ended."""

    code: int
    stdout: str
    stderr: str


def sfid(*arguments: str, cwd: Path | None = None) -> Done:
    """Run a command to its end, 60 s at most, in a process forked from one that has imported it."""
    request = {
        "arguments": [SFID, *arguments],
        "environment": dict(os.environ),
        "cwd": str(cwd or Path.cwd()),
    }
    ours, theirs = socket.socketpair()
    with (
        ours,
        theirs,
        Path(os.devnull).open() as nothing,
        TemporaryFile("w+") as out,
        TemporaryFile("w+") as err,
    ):
        descriptors = [each.fileno() for each in (nothing, out, err, theirs)]
        socket.send_fds(_server(), [json.dumps(request).encode()], descriptors)
        theirs.close()
        ours.settimeout(COMMAND_S)
        with ours.makefile() as told:
            pid = int(told.readline())
            try:
                code = int(told.readline())
            except TimeoutError:
                kill(pid)
                raise
        out.seek(0)
        err.seek(0)
        return Done(code, out.read(), err.read())


@cache
def _server() -> socket.socket:
    """Start the process that forks the commands; it ends with this one."""
    ours, theirs = socket.socketpair()
    with theirs:
        script = str(Path(__file__).with_name("command_server.py"))
        command = [sys.executable, "-P", script, str(theirs.fileno())]
        process = subprocess.Popen(command, pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL)

    def end() -> None:
        ours.close()
        process.wait()

    atexit.register(end)
    return ours


@contextmanager
def running(*arguments: str, stderr: Path | None = None) -> Iterator[subprocess.Popen[str]]:
    """Run a command beside the test; what is left of it ends with the block."""
    with (stderr or Path(os.devnull)).open("w") as errors:
        process = subprocess.Popen(
            [SFID, *arguments], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, text=True
        )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def wait_for(what: str, happened: Callable[[], bool], seconds: float = 30.0) -> None:
    """Return as soon as it has happened; fail when that takes longer than the deadline."""
    deadline = time.monotonic() + seconds
    # Another process's files and states announce nothing: they are looked at again, at a steady pace.
    pace = threading.Event()
    while not happened():
        assert time.monotonic() < deadline, f"{what}: not within {seconds} s"
        pace.wait(0.02)


def alive(pid: int) -> bool:
    """Tell whether the process runs; one that waits to be buried does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def processes(data_dir: Path) -> dict[str, int]:
    """Return who runs under which process id, empty while nobody does."""
    try:
        rows: list[dict[str, Any]] = json.loads((data_dir / "processes.json").read_text())
    except OSError:
        return {}
    return {row["role"]: row["pid"] for row in rows}


def kill(pid: int) -> None:
    """End a process without a word."""
    os.kill(pid, signal.SIGKILL)
