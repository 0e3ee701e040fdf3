"""`sfid` as a person runs it: a child process, its two outputs and its exit code."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

SFID = str(Path(sys.executable).with_name("sfid"))


class Done(NamedTuple):
    """How a command ended."""

    code: int
    stdout: str
    stderr: str


def sfid(*arguments: str, cwd: Path | None = None) -> Done:
    """Run a command to its end, 60 s at most."""
    done = subprocess.run(
        [SFID, *arguments], cwd=cwd, capture_output=True, text=True, timeout=60, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    return Done(done.returncode, done.stdout, done.stderr)


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
