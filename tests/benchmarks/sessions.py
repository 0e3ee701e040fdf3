"""One learner with many sessions: label to acknowledgement, what each process costs, and how that grows.

    python tests/benchmarks/sessions.py [--sessions 1000] [--seconds 20] [--growth] [--idle 10000] [--json]

Real services in processes of their own. Every session has one teacher who answers once in each window of one
second, at a moment of their own; a few client processes hold all teachers, one connection each. Every
acknowledgement follows a sync of the learner's disk. The anchor, in the same run: bare Zenoh queries through
the same router at the same rate, from the same client processes. At the end the learner's own count is
compared: an answer that was sent and is not in its journal is lost.

--growth measures 10, 100, 300, 1,000 and 3,000 sessions. --idle creates so many sessions that nobody teaches
and measures memory, creation, listing, a restart, and one taught session beside them. All of it takes less
than four minutes. It judges nothing but says of each bar whether it was met; lost answers make it fail.
"""

import argparse
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import rig

from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import CreateSession, WindowSpec
from protocol.status_message import ServiceStatus
from services.cli.shared import launch
from services.operations.status import ask
from services.operator import Operator
from services.runtime.bus import Reply
from services.runtime.zenoh_bus import ZenohBus
from services.supervisor import Supervisor

HERE = Path(__file__).parent
CLIENTS = 2
WINDOW_MS = 1_000
GROWTH = (10, 100, 300, 1_000, 3_000)
GROWTH_SECONDS = 8.0
RAW_SECONDS = 4.0
WARM_S = 3.0
JOINS_PER_S = 500
CREATING = 24
"""Creations under way at once: the learner lets 32 of one kind wait."""
CREATED_WITHIN_S = 120.0
HURRIED = 1_000
TARGET_P99_MS = 50.0
TARGET_BYTES = 10_240
MEASURED = ("learner", "router", "environment")
TICKS = os.sysconf("SC_CLK_TCK")
PAUSE = threading.Event()
"""Never set: what waits for it waits that long."""


@dataclass(frozen=True)
class House:
    """Running services, by name of the process."""

    deployed: launch.Deployed
    supervisor: Supervisor
    bus: ZenohBus
    keys: Keys
    operator: Operator

    def pid(self, name: str) -> int:
        """Return the process id of a service as it runs now."""
        return dict(self.supervisor.processes())[name]

    def status(self) -> ServiceStatus:
        """Return what the learner says of itself."""
        found = ask(self.bus, self.keys, "learner", "shard-0").status
        assert found is not None
        return found


@contextmanager
def house() -> Iterator[House]:
    """Yield fresh services that know nobody yet."""
    with rig.running() as (deployed, supervisor, bus):
        keys = Keys(deployed.deployment)
        yield House(deployed, supervisor, bus, keys, Operator(bus, keys, patience_s=60.0))


class Client:
    """A process of teachers."""

    def __init__(self, deployed: launch.Deployed) -> None:
        command = [sys.executable, str(HERE / "session_teachers.py"), deployed.endpoint, deployed.deployment]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        assert self._line() == "ready\n"

    def tell(self, **command: Any) -> None:  # noqa: ANN401 - any JSON
        """Give a command."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(command) + "\n")

    def answer(self) -> dict[str, Any]:
        """Wait for what came of it."""
        return dict(json.loads(self._line()))

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def close(self) -> None:
        """Let the process end."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(20)


@contextmanager
def clients(deployed: launch.Deployed, count: int) -> Iterator[list[Client]]:
    """Yield processes of teachers."""
    with ExitStack() as stack:
        made = []
        for _ in range(count):
            made.append(Client(deployed))
            stack.callback(made[-1].close)
        yield made


# ---------------------------------------------------------------- what is measured


def config(name: str, number: int, window: WindowSpec, teachers_min: int = 1) -> CreateSession:
    """Return a session with a seed of its own."""
    made: CreateSession = rig.session_config(name, window, 100_000, teachers_min)
    return msgspec.structs.replace(made, seed=number)


def create(house: House, configs: list[CreateSession]) -> float:
    """Create sessions, some at a time, and return the seconds that took."""
    done: queue.SimpleQueue[tuple[bytes, Reply | None]] = queue.SimpleQueue()
    payloads = [encode(each) for each in reversed(configs)]
    begun, under_way = time.perf_counter(), 0
    while payloads or under_way:
        while payloads and under_way < CREATING:
            payload = payloads.pop()
            house.bus.ask(
                house.keys.learner("create"), payload,
                lambda reply, payload=payload: done.put((payload, reply)), 5_000,  # type: ignore[misc]
            )  # fmt: skip
            under_way += 1
        payload, reply = done.get()
        under_way -= 1
        if reply is None or not reply.ok:
            assert time.perf_counter() - begun < CREATED_WITHIN_S, reply
            payloads.append(payload)
    return time.perf_counter() - begun


def cpu_s(pid: int) -> float:
    """Return the processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def resident_bytes(pid: int) -> int:
    """Return how much memory of a process is resident."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmRSS:"))


def taught(sessions: int, seconds: float) -> dict[str, Any]:
    """Return the figures of so many sessions, taught in fresh services."""
    with ExitStack() as stack:
        running = stack.enter_context(house())
        stack.enter_context(rig.bare(running.deployed.endpoint, "echo"))
        teachers = stack.enter_context(clients(running.deployed, min(CLIENTS, sessions)))
        raw = _raw(teachers, sessions * 1000 / WINDOW_MS)
        window = WindowSpec(mode="full", span_ms=WINDOW_MS)
        names = [f"s{number}" for number in range(sessions)]
        made_s = create(running, [config(name, number, window) for number, name in enumerate(names)])
        told, cpu = _teach(running, teachers, names, seconds)
        submitted = running.status().labels.submitted
        resident = resident_bytes(running.pid("learner"))
    latencies = [value / 1000 for each in told for value in each["latencies_us"]]
    lateness = [value / 1000 for each in told for value in each["late_us"]]
    sent = sum(each["sent"] for each in told)
    acknowledged = sum(sum(each["codes"].values()) for each in told)
    return {
        "sessions": sessions,
        "answers_timed": len(latencies),
        "answers_per_second": len(latencies) / seconds,
        "decisions_per_session_second": sum(each["decisions"] for each in told) / seconds / sessions,
        "p50_ms": rig.percentile(latencies, 0.5),
        "p99_ms": rig.percentile(latencies, 0.99),
        "max_ms": max(latencies),
        "raw_p50_ms": rig.percentile(raw, 0.5),
        "raw_p99_ms": rig.percentile(raw, 0.99),
        "sender_late_p99_ms": rig.percentile(lateness, 0.99),
        "cpu_cores": {name: round(share, 3) for name, share in cpu.items()},
        "learner_cpu_us_an_answer": 1e6 * cpu["learner"] * seconds / max(1, len(latencies)),
        "learner_resident_mb": resident / 2**20,
        "create_us_a_session": 1e6 * made_s / sessions,
        "sent": sent,
        "acknowledged": acknowledged,
        "journaled": submitted,
        "lost": sent - min(acknowledged, submitted),
        "sent_again": sum(each["unanswered"] + sum(each["refusals"].values()) for each in told),
        "codes": _summed([each["codes"] for each in told]),
    }


def _raw(teachers: list[Client], rate: float) -> list[float]:
    """Return the times in ms of bare queries at that rate over all clients."""
    for client in teachers:
        client.tell(do="raw", rate=rate / len(teachers), seconds=RAW_SECONDS)
    return [value / 1000 for client in teachers for value in client.answer()["latencies_us"]]


def _teach(
    running: House, teachers: list[Client], names: list[str], seconds: float
) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """Return what the clients tell, and the processor time of each service a second of the measured time."""
    ramp = max(1.0, len(names) / JOINS_PER_S)
    for number, client in enumerate(teachers):
        mine = names[number :: len(teachers)]
        client.tell(do="teach", sessions=mine, ramp=ramp, warm=WARM_S, seconds=seconds, window_ms=WINDOW_MS)
    PAUSE.wait(ramp + WARM_S)
    pids = {name: running.pid(name) for name in MEASURED}
    before, begun = {name: cpu_s(pid) for name, pid in pids.items()}, time.perf_counter()
    PAUSE.wait(seconds)
    elapsed = time.perf_counter() - begun
    cpu = {name: (cpu_s(pid) - before[name]) / elapsed for name, pid in pids.items()}
    return [client.answer() for client in teachers], cpu


def _summed(counts: list[dict[str, int]]) -> dict[str, int]:
    return {code: sum(each.get(code, 0) for each in counts) for code in sorted(set().union(*counts))}


def idle(sessions: int) -> dict[str, Any]:
    """Return what sessions cost that nobody teaches, with fresh services, and one taught beside them.

    Two of so many are taught, one after the other: a learner takes 10,000 at most.
    """
    hurried = WindowSpec(mode="until-answered", span_ms=WINDOW_MS)
    with house() as running, clients(running.deployed, 1) as teachers:
        create(running, [config("alone", 0, hurried), config("beside", 1, hurried)])
        alone = _hurry(teachers[0], "alone")
        before = {name: resident_bytes(running.pid(name)) for name in MEASURED}
        names = [f"idle{number}" for number in range(sessions - 2)]
        configs = [config(name, number, hurried, teachers_min=0) for number, name in enumerate(names)]
        made_s = create(running, configs)
        _await(lambda: running.status().backlog == 0)
        after = {name: resident_bytes(running.pid(name)) for name in MEASURED}
        beside = _hurry(teachers[0], "beside")
        begun = time.perf_counter()
        listed = len(running.operator.sessions().sessions)
        list_s = time.perf_counter() - begun
        restart_s = _restarted(running)
        kept = running.status().sessions
    grown = {name: (after[name] - before[name]) / sessions for name in MEASURED}
    return {
        "idle_sessions": sessions,
        "learner_bytes_a_session": grown["learner"],
        "environment_bytes_a_session": grown["environment"],
        "router_bytes_a_session": grown["router"],
        "create_us_a_session": 1e6 * made_s / sessions,
        "listed": listed,
        "list_ms": 1000 * list_s,
        "restart_s": restart_s,
        "sessions_after_restart": kept,
        "alone_p50_ms": rig.percentile(alone, 0.5),
        "alone_p99_ms": rig.percentile(alone, 0.99),
        "beside_p50_ms": rig.percentile(beside, 0.5),
        "beside_p99_ms": rig.percentile(beside, 0.99),
    }


def _hurry(client: Client, session: str) -> list[float]:
    client.tell(do="hurry", session=session, answers=HURRIED)
    return [value / 1000 for value in client.answer()["latencies_us"]]


def _restarted(running: House) -> float:
    """Kill the learner and return the seconds until another one, which the supervisor starts, answers."""
    killed, begun = running.pid("learner"), time.perf_counter()
    os.kill(killed, signal.SIGKILL)

    def answers() -> bool:
        found = ask(running.bus, running.keys, "learner", "shard-0").status
        return found is not None and found.pid != killed

    _await(answers)
    return time.perf_counter() - begun


def _await(true: Callable[[], bool], timeout_s: float = 120.0) -> None:
    until = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < until
        PAUSE.wait(0.05)


# ---------------------------------------------------------------- what is printed


def bars(result: dict[str, Any]) -> dict[str, str]:
    """Say of each bar whether it was met."""
    said = {}
    main_run = result["taught"]
    said[f"p99 of {main_run['sessions']} sessions at most {TARGET_P99_MS:g} ms"] = _met(
        main_run["p99_ms"] <= TARGET_P99_MS
    )
    runs = [main_run, *result.get("growth", [])]
    said["none lost"] = _met(all(run["lost"] == 0 for run in runs))
    if "idle" in result:
        beside = result["idle"]
        said[f"{beside['idle_sessions']} idle sessions, {TARGET_BYTES} bytes each at most"] = _met(
            beside["learner_bytes_a_session"] <= TARGET_BYTES
        )
        said["all there after a restart"] = _met(beside["sessions_after_restart"] == beside["idle_sessions"])
    return said


def _met(true: bool) -> str:  # noqa: FBT001 - what it says
    return "met" if true else "not met"


COLUMNS = (
    ("sessions", "sessions", "{:.0f}"),
    ("answers/s", "answers_per_second", "{:.0f}"),
    ("p50 ms", "p50_ms", "{:.2f}"),
    ("p99 ms", "p99_ms", "{:.2f}"),
    ("raw p50", "raw_p50_ms", "{:.2f}"),
    ("raw p99", "raw_p99_ms", "{:.2f}"),
    ("CPU us/answer", "learner_cpu_us_an_answer", "{:.0f}"),
)


def curve(runs: list[dict[str, Any]]) -> str:
    """Return the growth curve as a table for people."""
    names = [title for title, _, _ in COLUMNS] + [f"{name} cores" for name in MEASURED]
    lines = ["  ".join(f"{name:>17}" for name in names)]
    for run in runs:
        cells = [form.format(run[key]) for _, key, form in COLUMNS]
        cells += [f"{run['cpu_cores'][name]:.2f}" for name in MEASURED]
        lines.append("  ".join(f"{cell:>17}" for cell in cells))
    return "\n".join(lines)


def main() -> None:
    """Run and print; exit 1 when an answer was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--sessions", type=int, default=1_000)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--idle", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    result: dict[str, Any] = {"taught": taught(chosen.sessions, chosen.seconds)}
    if chosen.growth:
        result["growth"] = [taught(sessions, GROWTH_SECONDS) for sessions in GROWTH]
    if chosen.idle:
        result["idle"] = idle(chosen.idle)
    result["load_average"] = os.getloadavg()[0]
    result["bars"] = bars(result)
    if chosen.json:
        print(json.dumps(result))
    else:
        rig.print_result(result["taught"], as_json=False)
        if chosen.growth:
            print(curve(result["growth"]))
        rig.print_result(result.get("idle", {}) | result["bars"], as_json=False)
    sys.exit(0 if result["bars"]["none lost"] == "met" else 1)


if __name__ == "__main__":
    main()
