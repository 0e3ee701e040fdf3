"""What watching costs: ten hours of teaching, compressed; and teaching beside viewers, or without any.

    .venv/bin/python tests/benchmarks/monitor.py [--json] [--hours 10 --speed 100] [--runs 5 --labels 5000]

1. Hours: a monitor of its own process is sent a session of 5 decisions a second, and time passes for both
   `--speed` times as fast (the messages carry the session's own time, which the rules of thinning go by).
   Told: the most memory that it held, what it dropped, and how long a viewer who comes then waits for its
   first picture and the curves.
2. Beside: a teacher labels as fast as it is acknowledged, at a learner and monitor in processes of their own;
   absent (no viewer), stopped (one, frozen by SIGSTOP) and ten (`--save` clients), interleaved run by run.
   Viewers have come before the first label: each has its program loaded and the past fetched.
   Viewers run only in time that nobody else wants and save to memory, because people watch from machines of
   their own.
   Told: p50 and p99 of acknowledgements, and the ratio to absent in the median pair.
"""

import argparse
import os
import queue
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import msgspec
from rig import Rig, percentile, print_result, services, session_config

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Answer, Decision, Episode, Join, Step, Welcome, WindowSpec
from protocol.status_message import ServiceStatus
from services.monitor.config import LOOPBACK, free_port
from services.monitor.web import viewer_program
from services.router import free_endpoint
from services.runtime.bus import Reply
from services.runtime.zenoh_bus import ZenohBus, open_bus
from tests.benchmarks.late_viewer import reached
from tests.services.monitor.feeder import Lesson
from tests.services.monitor.rrd_rows import rows_of

DECISIONS_A_SECOND = 5
MESSAGES_A_DECISION = 3
"""Opened, closed, learnt; ends of episodes come on top."""
HURRIED = str(Path(__file__).with_name("hurried_monitor.py"))
BATCH = 500
"""Decisions sent between two looks at the monitor."""
MEMORY_MB_MAX = 700
WAIT_S = 60.0
WATCHED_S = 10.0
"""For how long a late viewer is watched: thrice as long as it may take. What comes later is told as that."""
PAUSE = threading.Event()
"""Never set: other processes are waited for, and looked at now and then."""
VIEWERS = 10
MEMORY = Path("/dev/shm")  # noqa: S108 - a directory of its own is made in it
"""Where viewers save: what they write is no load of the journal's disk, as on machines of their own."""


class Monitor:
    """A monitor in a process of its own."""

    def __init__(self, endpoint: str, deployment: str, folder: Path, speed: float | None = None) -> None:
        self.ports = [free_port(set()) for _ in range(2)]
        scene_port, curves_port = map(str, self.ports)
        command = [
            sys.executable, "-m", "services.cli.main", "monitor", "--recordings", str(folder), "--connect",
            endpoint, "--deployment", deployment, "--scene-port", scene_port, "--curves-port", curves_port,
            "--web-port", "0",
        ]  # fmt: skip
        if speed is not None:
            what = [endpoint, deployment, str(folder), scene_port, curves_port, str(speed)]
            command = [sys.executable, HURRIED, *what]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        for stream in (self.process.stdout, self.process.stderr):
            threading.Thread(target=_read, args=(stream, lines), daemon=True).start()
        while "rerun --connect" not in lines.get(timeout=WAIT_S):
            pass

    def memory_mb(self) -> tuple[float, float]:
        """Resident memory now, and at its highest."""
        rows = Path(f"/proc/{self.process.pid}/status").read_text().splitlines()
        known = {row.split(":")[0]: row.split()[1] for row in rows if row.startswith(("VmRSS", "VmHWM"))}
        return int(known["VmRSS"]) / 1024, int(known["VmHWM"]) / 1024

    def cpu_s(self) -> float:
        """CPU time so far."""
        return cpu_s(self.process.pid)

    def close(self) -> None:
        """End it."""
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(10)
        finally:
            self.process.kill()


def cpu_s(pid: int) -> float:
    """CPU time of a process so far."""
    parts = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(parts[11]) + int(parts[12])) / os.sysconf("SC_CLK_TCK")


def _read(stream: Iterable[str], lines: queue.SimpleQueue[str]) -> None:
    for line in stream:
        lines.put(line)


@contextmanager
def viewer(path: Path, monitor: Monitor) -> Iterator[subprocess.Popen[bytes]]:
    """A viewer without a window that writes what it is shown."""
    urls = [f"rerun+http://{LOOPBACK}:{port}/proxy" for port in reversed(monitor.ports)]
    own = ["--port", str(free_port(set())), "--bind", LOOPBACK]
    process = subprocess.Popen(
        ["chrt", "--idle", "0", str(viewer_program()), "--save", str(path), *own, *urls],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def long_lesson(decisions: int) -> Iterator[Decision | Step | Episode]:
    """A session of so many decisions, 200 ms apart by its own clock."""
    lesson = Lesson(session="long", episodes=1_000_000)
    for message in lesson.messages():
        if isinstance(message, Step | Episode):
            at_ns = message.at_ns + lesson.decision * (10**9 // DECISIONS_A_SECOND - 250_000_000)
            yield msgspec.structs.replace(message, at_ns=at_ns)
        else:
            yield message
        if lesson.decision >= decisions:
            return


def hours(count: float, speed: float) -> dict[str, object]:
    """Send the hours, then let a viewer come."""
    decisions = int(count * 3600 * DECISIONS_A_SECOND)
    messages_a_second = DECISIONS_A_SECOND * MESSAGES_A_DECISION * speed
    with tempfile.TemporaryDirectory(prefix="sfid-bench-") as name, ExitStack() as stack:
        endpoint = free_endpoint()
        router = subprocess.Popen(
            [sys.executable, "-m", "services.cli.main", "router", "--listen", endpoint, "--open-to-all"],
            stdout=subprocess.DEVNULL,
        )
        stack.callback(router.wait)
        stack.callback(router.terminate)
        bus = open_bus(endpoint, 20_000)
        stack.callback(bus.close)
        monitor = Monitor(endpoint, "bench", Path(name), speed)
        stack.callback(monitor.close)
        begun, episodes, dropped, resident = time.monotonic(), 0, 0, []
        for number, message in enumerate(long_lesson(decisions)):
            PAUSE.wait(max(0.0, begun + number / messages_a_second - time.monotonic()))
            publish(bus, message)
            episodes += isinstance(message, Episode)
            if number % BATCH == BATCH - 1:
                dropped = settle(bus)
                resident.append(monitor.memory_mb()[0])
        sent_s = time.monotonic() - begun
        PAUSE.wait(6.0)
        monitor.process.send_signal(signal.SIGUSR1)
        appeared, told, held = late(Path(name) / "late.rrd", monitor, episodes)
        now_mb, most_mb = monitor.memory_mb()
        tenth = max(1, len(resident) // 10)
        return {
            "hours": count, "speed": speed, "decisions": decisions, "episodes": episodes, "sent_in_s": sent_s,
            "dropped_messages": dropped, "monitor_cpu_s": monitor.cpu_s(),
            "memory_mb_most": most_mb, "memory_mb_now": now_mb,
            "memory_mb_after_a_tenth": resident[tenth - 1], "memory_mb_limit": float(MEMORY_MB_MAX),
            "late_viewer_shown_after_s": appeared, "late_viewer_has_all_after_s": told,
            "late_viewer_target_s": 3.0, "late_viewer_episodes": held,
        }  # fmt: skip


def publish(bus: ZenohBus, message: Decision | Step | Episode) -> None:
    """Say what a learner says."""
    keys = Keys("bench")
    key = keys.decision if isinstance(message, Decision) else keys.measures
    bus.publish(key(message.session), encode(message))


def settle(bus: ZenohBus) -> int:
    """Wait until the monitor has worked off what it was sent; return how many messages it has dropped."""
    key = Keys("bench").status("monitor", "0")
    while True:
        replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        bus.ask(key, b"", replies.put, 5_000)
        reply = replies.get()
        if reply is not None and reply.ok:
            status = decode(reply.payload, ServiceStatus)
            if status.backlog == 0:
                return status.refused.get("dropped", 0)
        PAUSE.wait(0.02)


def late(path: Path, monitor: Monitor, episodes: int) -> tuple[float | str, float | str, int]:
    """Return the seconds from a viewer's start until it had a picture and the curves, and until all of these;
    and how many episodes it had in the end.

    What it saves is only measured while it comes, and read afterwards: its first bytes up to each moment.
    What has not come while it was watched is said to take longer.
    """
    begun, sizes = time.monotonic(), [(0.0, 0)]
    with viewer(path, monitor):
        while (now_s := time.monotonic() - begun) < WATCHED_S:
            size = path.stat().st_size if path.exists() else 0
            if size > sizes[-1][1]:
                sizes.append((now_s, size))
            PAUSE.wait(0.02)
    saved = path.read_bytes() if path.exists() else b""
    shown_s, told_s = reached(sizes, saved, lambda part: _episodes_in(path, part), (1, max(1, episodes)))
    return _seconds(shown_s), _seconds(told_s), _episodes_in(path, saved)


def _seconds(reached_s: float | None) -> float | str:
    return f">= {WATCHED_S:g}" if reached_s is None else reached_s


def _episodes_in(path: Path, saved: bytes) -> int:
    """Return how many episodes' steps have come, if a picture has come too."""
    part = path.with_suffix(".part.rrd")
    part.write_bytes(saved)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            pictured = rows_of(part, "world", "SegmentationImage:buffer")
            return len(rows_of(part, "curves/steps", "Scalars:scalars")) if pictured else 0
        except (OSError, RuntimeError, ValueError):  # it has the header and no row yet
            return 0


def beside(runs: int, labels: int) -> dict[str, object]:
    """Teach beside no viewer, a stopped one, and ten."""
    found: dict[str, list[tuple[float, float]]] = {"absent": [], "stopped": [], "ten": []}
    with services() as rig, ExitStack() as stack:
        monitor = Monitor(rig.endpoint, rig.keys.deployment, rig.data / "recordings")
        stack.callback(monitor.close)
        for run in range(runs):
            for name, pairs in found.items():
                pairs.append(_taught(rig, monitor, f"{name}-{run}", name, labels))
    result: dict[str, object] = {"runs": runs, "labels_a_run": labels, "ratio_target": 1.2}
    for name, pairs in found.items():
        result[f"{name}_us_p50"] = statistics.median(p50 for p50, _ in pairs) * 1e6
        result[f"{name}_us_p99"] = statistics.median(p99 for _, p99 in pairs) * 1e6
        for index, share in enumerate(("p50", "p99")):
            ratios = [pair[index] / base[index] for pair, base in zip(pairs, found["absent"], strict=True)]
            result[f"{name}_to_absent_{share}"] = statistics.median(ratios)
    return result


def _taught(rig: Rig, monitor: Monitor, session: str, viewers: str, labels: int) -> tuple[float, float]:
    with ExitStack() as stack:
        elsewhere = Path(
            stack.enter_context(tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None))
        )
        watching = [
            stack.enter_context(viewer(elsewhere / f"{session}-{number}.rrd", monitor))
            for number in range({"absent": 0, "stopped": 1, "ten": VIEWERS}[viewers])
        ]
        _have_come(watching)
        if viewers == "stopped":
            watching[0].send_signal(signal.SIGSTOP)
        window = WindowSpec(mode="until-answered", span_ms=1_000)
        rig.operator.create(session_config(session, window, 1_000_000))
        times = _labels(rig, session, labels)
        rig.operator.control(session, "stop")
    return statistics.median(times), percentile(times, 0.99)


def _have_come(watching: Sequence[subprocess.Popen[bytes]]) -> None:
    """Wait until viewers have loaded and fetched the past: their CPU time stands nearly still."""
    until, before = time.monotonic() + WAIT_S, -1.0
    while time.monotonic() < until:
        PAUSE.wait(1.0)
        now = sum(cpu_s(process.pid) for process in watching)
        if now - before < 0.01 * max(1, len(watching)):
            return
        before = now


def _labels(rig: Rig, session: str, labels: int) -> list[float]:
    """Label each decision as soon as it opens; return how long each acknowledgement took."""
    opened: queue.SimpleQueue[Decision] = queue.SimpleQueue()
    rig.bus.subscribe(rig.keys.decision(session), lambda got: opened.put(decode(got.payload, Decision)))
    rig.bus.announce(rig.keys.present(session, "t0"))
    welcome = decode(
        _ask(rig, rig.keys.join(session, "t0"), encode(Join(session=session, teacher="t0"))), Welcome
    )
    times: list[float] = []
    answered = -1
    decision = welcome.decision
    while len(times) < labels:
        if decision.phase == "asking" and decision.decision > answered:
            answered = decision.decision
            message = Answer(
                answer_id=os.urandom(16), session=session, teacher="t0", epoch=decision.epoch,
                decision=answered, episode=decision.episode, step=decision.step, state=decision.state,
                kind="label", action=decision.actions[answered % 4], response_ms=0,
            )  # fmt: skip
            begun = time.perf_counter()
            _ask(rig, rig.keys.answer(session, "t0"), encode(message))
            times.append(time.perf_counter() - begun)
        decision = opened.get(timeout=WAIT_S)
    return times


def _ask(rig: Rig, key: str, payload: bytes) -> bytes:
    replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    rig.bus.ask(key, payload, replies.put, 5_000)
    reply = replies.get()
    assert reply is not None
    assert reply.ok, reply.payload
    return reply.payload


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--speed", type=float, default=100.0)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--labels", type=int, default=5_000)
    parser.add_argument("--skip", choices=("hours", "beside"))
    asked = parser.parse_args()
    result: dict[str, object] = {}
    if asked.skip != "hours":
        result |= hours(asked.hours, asked.speed)
    if asked.skip != "beside":
        result |= beside(asked.runs, asked.labels)
    print_result(result, as_json=asked.json)


if __name__ == "__main__":
    main()
