"""What all tests share: kernels are compiled once for all processes of a run, and again when they change.

Compiling takes minutes, in one thread. In a run of many tests a process beside them does it, and the tests
that want the compiler come last.
"""

import os
import signal
import subprocess
import sys

import pytest

from services.runtime.sources import core_digest
from sfid_core.compiled import compiler_available

MANY = 500
"""So many tests take longer than compiling does."""
AHEAD = pytest.StashKey[subprocess.Popen[bytes]]()


def pytest_configure(config: pytest.Config) -> None:
    # A shell starts what runs in the background deaf to interruptions, and processes inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    cache: pytest.Cache | None = getattr(config, "cache", None)  # there is none with `-p no:cacheprovider`
    if cache is not None:
        os.environ.setdefault("NUMBA_CACHE_DIR", str(cache.mkdir(f"kernels-{core_digest()[:16]}")))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.get_closest_marker("compiler") is not None)


def pytest_collection_finish(session: pytest.Session) -> None:
    wanted = any(item.get_closest_marker("compiler") for item in session.items)
    kept = "NUMBA_CACHE_DIR" in os.environ and compiler_available()
    if wanted and kept and len(session.items) >= MANY and not session.config.option.collectonly:
        command = [sys.executable, "-m", "tests.core.experiments.compile_ahead"]
        session.config.stash[AHEAD] = subprocess.Popen(command, cwd=session.config.rootpath)


def pytest_unconfigure(config: pytest.Config) -> None:
    ahead = config.stash.get(AHEAD, None)
    if ahead is not None:
        ahead.terminate()
        ahead.wait()
