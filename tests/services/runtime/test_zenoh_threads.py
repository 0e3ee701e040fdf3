"""Zenoh's threads in a process of ours: few, so that a message wakes few, unless somebody says otherwise."""

import os
import subprocess
import sys

import pytest

from services.runtime.zenoh_config import THREADS_VARIABLE

PROGRAM = """
import sys, time
from pathlib import Path
from services.router import free_endpoint
from services.runtime.zenoh_bus import ZenohRouter, open_bus
endpoint = free_endpoint()
router = ZenohRouter(endpoint, "")
bus = open_bus(endpoint, 5_000)
names, awaited, until_s = set(), set(sys.argv[1:]), time.monotonic() + 10
while not awaited <= names and time.monotonic() < until_s:  # they come with the link, one after the other
    names = {each.read_text().strip() for each in Path("/proc/self/task").glob("*/comm")}
print(*sorted(name for name in names if name.partition("-")[0] in ("app", "acc", "net", "rx", "tx")))
bus.close()
router.close()
"""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="threads are read from /proc")


def threads(*awaited: str, **variables: str) -> set[str]:
    """Return the threads of Zenoh in a fresh process that routes and is a client, once these are there."""
    kept = {name: value for name, value in os.environ.items() if name != THREADS_VARIABLE}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *awaited],
        env=kept | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stdout.split())


def test_all_but_receiving_shares_its_threads() -> None:
    expected = {"rx-0", "rx-1", "tx-0", "tx-1", "tx-2", "tx-3"}
    found = threads(*expected)
    assert expected <= found
    assert {name.partition("-")[0] for name in found} == {"rx", "tx"}


def test_whoever_sets_zenohs_own_variable_is_heeded() -> None:
    assert "net-0" in threads("net-0", **{THREADS_VARIABLE: "(rx: (worker_threads: 1))"})
