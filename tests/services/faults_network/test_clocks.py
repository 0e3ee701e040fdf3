"""Wall clocks that jump, and monotonic ones that start elsewhere, change neither order nor windows."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from protocol.messages import WindowSpec
from services.runtime.journal import read_rows
from tests.services.cli.command_line import SFID, wait_for
from tests.services.faults_network.conftest import Tell
from tests.services.faults_network.rig import Rig, account, acknowledged, more

pytestmark = [pytest.mark.real, pytest.mark.timeout(240)]

LIBRARY = next(iter(sorted(Path("/usr/lib").glob("*/faketime/libfaketime.so.1"))), None)
JUMPS = ("+3600", "-3600", "+86400", "-86400", "+0")
"""Seconds that the learner's wall clock is put forward or back, one after another."""
OFFSETS_S = (86_400, 3_600)
"""Monotonic clocks that begin so much later than the others'."""
WINDOW_MS = 400
TURN_S = 1.2


@contextmanager
def learner_under(rig: Rig, command: list[str], environment: dict[str, str]) -> Iterator[None]:
    """Run the deployment's learner in another way for the time of the block."""
    rig.processes["learner"].terminate()
    assert rig.processes["learner"].wait(15) == 0
    log = rig.data.parent / f"learner-{time.monotonic_ns()}.log"
    arguments = [
        *command, sys.executable, SFID, "learner", "--connect", rig.learner_link.endpoint, "--data",
        str(rig.data), "--access", str(rig.access),
    ]  # fmt: skip
    with log.open("w") as errors:
        process = subprocess.Popen(
            arguments, env=os.environ | environment, stderr=errors, stdin=subprocess.DEVNULL
        )
    try:
        wait_for("the learner is ready", lambda: " ready" in log.read_text(), 60.0)
        yield
    finally:
        process.terminate()
        try:
            assert process.wait(20) == 0, log.read_text()
        finally:
            process.kill()
            rig.start("learner")


def steady(rig: Rig, session: str) -> bool:
    """Tell whether the journal's times never go back within one life of the learner."""
    times: list[int] = []
    for row in read_rows(rig.data, session):
        if row.kind == "restarted":
            times = []
        if times and row.at_ns < times[-1]:
            return False
        times.append(row.at_ns)
    return True


@pytest.mark.skipif(LIBRARY is None, reason="libfaketime is not installed")
def test_a_wall_clock_that_jumps_by_hours_and_days_changes_no_order_and_ends_no_window(
    rig: Rig, tell: Tell, tmp_path: Path
) -> None:
    session, clock = "jumping", tmp_path / "clock"
    clock.write_text("+0\n")
    environment = {
        "LD_PRELOAD": str(LIBRARY), "FAKETIME_TIMESTAMP_FILE": str(clock), "FAKETIME_NO_CACHE": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }  # fmt: skip
    assert abs(_wall_s(environment) - time.time()) < 10
    clock.write_text("+86400\n")
    assert abs(_wall_s(environment) - time.time() - 86_400) < 10, "the library does what it is for"
    clock.write_text("+0\n")
    with learner_under(rig, [], environment):
        rig.create(session, WindowSpec(mode="early", span_ms=WINDOW_MS, quorum=2))
        with rig.teaching(session, 2) as voices:
            wait_for("teaching has begun", lambda: acknowledged(voices) > 4, 60.0)
            for jump in JUMPS:
                clock.write_text(f"{jump}\n")
                began = time.monotonic()
                goes_on = more(voices, 4)
                threading.Event().wait(TURN_S)
                wait_for("teaching goes on", goes_on, 10.0)
                assert time.monotonic() - began < TURN_S + 5
    told = account(rig.data, session, voices)
    assert told.sound, told
    assert steady(rig, session)
    late = sum(state.value == "too_late" for voice in voices for state, _ in voice.acknowledged.values())
    assert late <= told.acknowledged // 5, "no window was ended by a jump"
    tell(
        "F20 wall clock jumps by an hour and a day",
        "same order, no window ended by it",
        len(JUMPS),
        "jumps",
        f"{told.acknowledged} labels, 0 lost, 0 out of order, {late} late",
    )


def _wall_s(environment: dict[str, str]) -> float:
    command = [sys.executable, "-c", "import time; print(time.time())"]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, check=True, text=True)
    return float(done.stdout)


def _can_shift() -> bool:
    probe = ["unshare", "--time", "--monotonic", "60", "--fork", "true"]
    try:
        return subprocess.run(probe, capture_output=True, check=False, timeout=10).returncode == 0
    except OSError:
        return False


@pytest.mark.skipif(not _can_shift(), reason="time namespaces need root")
@pytest.mark.parametrize("offset_s", OFFSETS_S)
def test_a_learner_whose_monotonic_clock_stands_elsewhere_teaches_the_same(
    rig: Rig, tell: Tell, offset_s: int
) -> None:
    session = f"shifted-{offset_s}"
    command = ["unshare", "--time", "--monotonic", str(offset_s), "--boottime", str(offset_s), "--"]
    rig.create(session)
    with rig.teaching(session, 2) as voices:
        wait_for("teaching has begun", lambda: acknowledged(voices) > 4, 60.0)
        with learner_under(rig, command, {}):
            before = acknowledged(voices)
            wait_for("teaching goes on", lambda: acknowledged(voices) >= before + 6, 20.0)
        after = acknowledged(voices)
        wait_for("and afterwards", lambda: acknowledged(voices) >= after + 6, 20.0)
    told = account(rig.data, session, voices)
    assert told.sound, told
    assert steady(rig, session)
    tell(
        f"F20 monotonic clock {offset_s} s ahead, and back",
        "nothing lost, same order",
        told.acknowledged,
        "labels",
        "0 lost, 0 twice, 0 out of order",
    )
