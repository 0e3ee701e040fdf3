"""compose.yaml run for real: an agent is taught while containers are stopped, killed, paused and cut off.

Three teachers are counted, each on another way to a journal: one on the bus, one in a crowd, one on the page.
"""

import json
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from protocol.journal import Record
from protocol.who_said import said_to_a_crowd, said_to_a_learner
from services.replay import replay_crowds, replay_directory
from services.router import free_endpoint
from services.runtime.journal import read_rows, verify
from tests.containers.aftermath import told_when_failing
from tests.containers.bridges import keep_bridge_addresses
from tests.containers.counts import TICK_S, Row, Tally, table
from tests.containers.engine import (
    STOP_S,
    Engine,
    Stack,
    disconnect,
    found_engine,
    kill,
    pause,
    pip_settings,
    stop,
)
from tests.containers.names import ask_the_bus_last
from tests.containers.page_teacher import PageTeacher

SERVICES = ("router", "environment", "learner", "aggregator", "gateway", "monitor")
ON_TWO_NETWORKS = ("gateway", "monitor")
PORTS = ("PAGE", "WEB", "SCENE", "CURVES")
DEMO = ("session", "teacher", "crowd-session", "crowd")
BUS, CROWD, PAGE = "on the bus", "in the crowd", "on the page"
UNTOUCHED: dict[str, tuple[str, ...]] = {
    "monitor": (BUS, CROWD, PAGE), "gateway": (BUS, CROWD), "aggregator": (BUS, PAGE),
}  # fmt: skip
"""Who is taught as before while a service is not there."""
FAULTS: tuple[tuple[Callable[[Stack, str], Callable[[], None]], float], ...] = (
    (stop, 1.0), (kill, 0.0), (pause, 2.8), (disconnect, 2.8),
)  # fmt: skip
"""Each with how long it lasts, in s: a pause and a cut last longer than the silence a router puts up with."""
PACE_S = 0.05
FEW = 3
BACK_S = 100.0
"""Back is a matter of 2 s; this is when to give up."""
UP_S = 180.0
ALL_S = 600.0
LESSONS = {"bus-lesson": BUS, "crowd-lesson": CROWD, "page-lesson": PAGE}
CROWD_DATA = "/data/crowd-crowd"
INVITE = ("sfid", "invite", "--data", "/data", "--session", "page-lesson", "--name", "cleo", "--json")
SCRIPT = Path(__file__).with_name("counted_teacher.py")
IMAGE = "sfid-tested"


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Engine:
    """The engine, with both images built from these sources; skips where there is none."""
    found = found_engine()
    if isinstance(found, str):
        pytest.skip(found)
    pip = pip_settings(tmp_path_factory.mktemp("pip"))
    for target, image in (("service", IMAGE), ("monitor", f"{IMAGE}-monitor")):
        found.build(target, image, pip)
    return found


@dataclass
class Lesson:
    """The running stack, and who is counted."""

    stack: Stack
    tallies: tuple[Tally, ...]
    began_s: float
    rows: list[Row] = field(default_factory=list)

    def heard(self, count: int, since_s: float, why: str) -> None:
        """Wait until everybody has been told of so many more answers."""
        for tally in self.tallies:
            assert time.monotonic() - self.began_s < ALL_S, "the test takes too long"
            assert tally.wait_for(count, since_s, BACK_S), f"{why}: nothing acknowledged {tally.name}"

    def suffer(self, service: str, fault: Callable[[Stack, str], Callable[[], None]], lasts_s: float) -> None:
        """Let something happen to a service, mend it, and count."""
        name = f"{service} {fault.__name__}"
        start_s = time.monotonic()
        self.heard(FEW, start_s, f"before {name}")
        before = self.stack.inspect(service)["State"]["StartedAt"]
        fault_s = time.monotonic()
        mend = fault(self.stack, service)
        threading.Event().wait(max(0.0, lasts_s - (time.monotonic() - fault_s)))
        mend()
        if fault is kill:
            self._restarted(service, before)
        mended_s = time.monotonic()
        self.heard(FEW, mended_s, f"after {name}")
        end_s = time.monotonic()
        counts = tuple(
            (
                tally.between(start_s, fault_s),
                tally.between(fault_s, mended_s),
                tally.between(mended_s, end_s),
            )
            for tally in self.tallies
        )
        back_s = max(tally.first_after(mended_s) for tally in self.tallies) - mended_s
        self.rows.append(Row(service, fault.__name__, mended_s - fault_s, back_s, counts))

    def _restarted(self, service: str, before: str) -> None:
        until, tick = time.monotonic() + BACK_S, threading.Event()
        while True:
            state = self.stack.inspect(service)["State"]
            if state["Running"] and state["StartedAt"] != before:
                return
            assert time.monotonic() < until, f"{service} was killed and nobody started it again"
            tick.wait(TICK_S)


def becomes_healthy(stack: Stack, service: str) -> bool:
    """Run a service's health check until it is well; tell whether it is within UP_S."""
    until, tick = time.monotonic() + UP_S, threading.Event()
    while not (well := stack.is_healthy(service)) and time.monotonic() < until:
        tick.wait(TICK_S)
    return well


def port() -> str:
    return free_endpoint().rpartition(":")[2]


@contextmanager
def counted(stack: Stack, tally: Tally, service: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a teacher in a container of its own; its lines are counted as they come."""
    command = stack.teacher(service, SCRIPT, *arguments, str(int(PACE_S * 1000)))
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = process.stdout

        def listen() -> None:
            for line in lines:
                tally.add(line.strip())

        thread = threading.Thread(target=listen)
        thread.start()
        try:
            yield process
        finally:
            process.terminate()
            thread.join(BACK_S)
            process.wait(BACK_S)


def sessions_are_created(stack: Stack) -> None:
    """One session a counted teacher, too long to end: it goes on as soon as it is answered."""
    for name in LESSONS:
        stack.operator("session", "create", name, "--episodes", "100000", "--window-mode", "until-answered")


def everybody_teaches(stack: Stack, ends: ExitStack) -> Lesson:
    """Let the three teachers begin; they are stopped, the page's first, when `ends` does."""
    tallies = tuple(Tally(name) for name in LESSONS.values())
    lesson = Lesson(stack, tallies, time.monotonic())
    bus, crowd, page = tallies
    ends.enter_context(counted(stack, bus, "teacher", "bus-lesson", "ann", "local"))
    ends.enter_context(counted(stack, crowd, "crowd", "crowd-lesson", "bob", "local-crowd"))
    invited = stack.exec("gateway", *INVITE)
    url, _, token = json.loads(invited)["url"].partition("/#t=")
    teacher = PageTeacher(url, token, page, PACE_S * 2)
    ends.callback(teacher.close)
    return lesson


def kept(stack: Stack, tmp_path: Path) -> Path:
    """Copy the journals of learner and aggregator out of their volumes, as one data directory."""
    for service, inside, outside in (
        ("learner", "/data", "kept"),
        ("aggregator", CROWD_DATA, "kept/crowd-crowd"),
    ):
        (tmp_path / outside).mkdir()
        stack.tool("cp", f"{stack.id_of(service)}:{inside}/.", str(tmp_path / outside))
    return tmp_path / "kept"


def journaled(data: Path, session: str) -> Counter[str]:
    """How often each answer of the session's counted teacher is in the journal that acknowledged it."""
    crowd = session == "crowd-lesson"
    directory = data / "crowd-crowd" if crowd else data
    rows = read_rows(directory, session)
    records = [Record(row.kind, row.at_ns, row.body) for row in rows if row.body is not None]
    said = said_to_a_crowd(records, "crowd") if crowd else said_to_a_learner(records)
    return Counter(one.answer_id.hex() for one in said)


def miscounted(lesson: Lesson, data: Path) -> tuple[dict[str, int], dict[str, int]]:
    """Return how many acknowledged answers are not in the journal, and how many more than once, by tally."""
    lost, twice = {}, {}
    for session, tally in zip(LESSONS, lesson.tallies, strict=True):
        found = journaled(data, session)
        lost[tally.name] = sum(found[one] == 0 for one in tally.ids)
        twice[tally.name] = sum(count > 1 for count in found.values())
    return lost, twice


@pytest.mark.real
@pytest.mark.timeout(1200)  # building without a cache takes minutes; the test itself has ALL_S
def test_no_acknowledged_answer_is_lost_while_containers_are_stopped_killed_paused_and_cut_off(
    engine: Engine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    variables = {"SFID_IMAGE": IMAGE} | {f"SFID_{page}_PORT": port() for page in PORTS}
    stack = Stack(engine, f"sfid-tested-{os.getpid()}", variables)
    with ExitStack() as down:
        down.callback(stack.down)
        began_s = time.monotonic()
        down.enter_context(told_when_failing(stack))
        for group in (SERVICES[:1], SERVICES, DEMO):  # each bridge as soon as there is one
            stack.compose("up", "--detach", *group, wait_s=UP_S)
            keep_bridge_addresses(stack)
        ask_the_bus_last(stack, ON_TWO_NETWORKS)
        assert [service for service in SERVICES if not becomes_healthy(stack, service)] == []
        sessions_are_created(stack)
        up_s = time.monotonic() - began_s
        with ExitStack() as ends:
            lesson = everybody_teaches(stack, ends)
            lesson.heard(FEW, lesson.began_s, "at the start")
            for service in SERVICES:
                for fault, lasts_s in FAULTS:
                    lesson.suffer(service, fault, lasts_s)
            assert [service for service in SERVICES if not becomes_healthy(stack, service)] == []
        taught_s = time.monotonic() - lesson.began_s
        in_place = json.loads(stack.exec("learner", "sfid", "verify", "/data", "--json"))
        demo = json.loads(stack.operator("session", "show", "demo", "--json"))
        stack.tool("stop", "--time", STOP_S, *(stack.id_of(service) for service in reversed(SERVICES)))
        data = kept(stack, tmp_path)
    lost, twice = miscounted(lesson, data)
    told = ", ".join(f"{len(tally.ids)} {tally.name}" for tally in lesson.tallies)
    with capsys.disabled():
        sys.stdout.write(
            f"\n\n{engine.tool}: up in {up_s:.0f} s, taught for {taught_s:.0f} s\n"
            f"{table(lesson.tallies, lesson.rows)}\n"
            f"acknowledged: {told}; lost {sum(lost.values())}, twice {sum(twice.values())}\n\n"
        )
    assert (lost, twice) == (dict.fromkeys(lost, 0), dict.fromkeys(twice, 0))
    assert (in_place["ok"], in_place["problems"], verify(data).ok) == (True, [], True)
    assert verify(data / "crowd-crowd").ok
    assert [one.session for one in replay_directory(data) if not one.matches] == []
    assert [one.session for one in replay_crowds(data) if not one.matches] == []
    silent = [
        (row.service, row.fault, tally.name)
        for row in lesson.rows
        for tally, count in zip(lesson.tallies, row.counts, strict=True)
        if row.lasted_s >= 1.0 and tally.name in UNTOUCHED.get(row.service, ()) and not count[1]
    ]
    assert silent == []
    assert demo["phase"] == "finished"
    assert [one["outcome"] for one in demo["episodes"][-5:]] == ["solved"] * 5
