"""What a label costs routers: processor time and memory, at one router and over two that are linked.

    python -m tests.benchmarks.links [--rate 500] [--seconds 8] [--clients 100] [--idle 400] [--json]

Clients in this process, each on a connection of its own, ask as teachers do and hear a decision after each
answer; a process of its own answers in the learner's place, at once and without a disk. So what is counted is
the routers' alone: user and system time of their processes, which a busy machine does not lengthen much.
The ways: one router in clear text, one over TLS with logins and rules, and an edge linked to it over TLS,
with all clients at the edge. Memory is what each further client adds that is connected, subscribes and is
announced.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from protocol.keys import Keys
from services.router import free_endpoint
from services.runtime.bus import Reply
from services.runtime.zenoh_bus import ZenohBus
from services.topology import Role
from tests.services.linked import ask_until_served, bus_of, certified, tls_endpoint

KEYS = Keys("local")
ANSWER_BYTES, ACK_BYTES, DECISION_BYTES = 330, 120, 420
"""As a label with a token, its acknowledgement and a decision of the packaged room are."""
ANSWER = """
import sys
from pathlib import Path
from protocol.keys import Keys
from services.topology import Role
from tests.services.linked import bus_of

keys = Keys("local")
bus = bus_of(Role.LEARNER, sys.argv[1], Path(sys.argv[2]) if sys.argv[2] else None)
ack, decision = bytes(int(sys.argv[3])), bytes(int(sys.argv[4]))


def receive(request):
    request.reply(ack)
    bus.publish(keys.decision(request.key.split("/")[4]), decision)


bus.serve(keys.answer(), receive)
print("ready", flush=True)
sys.stdin.read()
bus.close()
"""


@dataclass(frozen=True)
class Measured:
    """What one way costs."""

    way: str
    labels: int
    lost: int
    router_us: dict[str, float]
    """Processor time of a label, by router."""
    client_kb: dict[str, float]
    """Memory of one further client, by router."""


def cpu_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_kb(pid: int) -> int:
    """Memory of a process now."""
    rows = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(row.split()[1]) for row in rows if row.startswith("VmRSS"))


@contextmanager
def started(*command: str) -> Iterator["subprocess.Popen[str]"]:
    """Run a Python process until the end of the block; it says when it is ready."""
    with subprocess.Popen(
        [sys.executable, *command],
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.terminate()
            process.communicate()


def router(stack: ExitStack, *arguments: str) -> int:
    """Start a router and return its process id."""
    process = stack.enter_context(started("-m", "services.cli.main", "router", *arguments))
    assert process.stderr is not None
    assert " ready" in process.stderr.readline()
    return process.pid


def measure(way: str, arguments: argparse.Namespace, folder: Path) -> Measured:
    """Ask through one of the ways at a steady rate, and read what the routers took for it."""
    with ExitStack() as stack:
        access = None if way == "clear" else folder
        guard = ("--open-to-all",) if access is None else ("--access", str(access))
        inner = free_endpoint() if access is None else tls_endpoint()
        routers = {"lab": router(stack, "--listen", inner, *guard)}
        outer = inner
        if way == "edge":
            outer = tls_endpoint()
            routers["edge"] = router(stack, "--listen", outer, "--connect", inner, "--edge", *guard)
        sizes = (str(ACK_BYTES), str(DECISION_BYTES))
        learner = stack.enter_context(started("-c", ANSWER, inner, str(access or ""), *sizes))
        assert learner.stdout is not None
        assert learner.stdout.readline() == "ready\n"
        asked, lost, used_s = _asked(_clients(stack, outer, access, arguments.clients), arguments, routers)
        before_kb = {name: resident_kb(pid) for name, pid in routers.items()}
        idle = _clients(stack, outer, access, arguments.idle, "idle")
        ask_until_served(idle[-1], KEYS.answer("idle", "last"))
        grown = {name: (resident_kb(pid) - before_kb[name]) / arguments.idle for name, pid in routers.items()}
    return Measured(way, asked, lost, {name: each * 1e6 / asked for name, each in used_s.items()}, grown)


def _clients(
    stack: ExitStack, endpoint: str, access: Path | None, count: int, name: str = "s"
) -> list[ZenohBus]:
    buses = []
    for number in range(count):
        bus = bus_of(Role.TEACHER, endpoint, access)
        stack.callback(bus.close)
        bus.subscribe(KEYS.decision(f"{name}{number}"), lambda _: None)
        bus.announce(KEYS.present(f"{name}{number}", "ann"))
        buses.append(bus)
    return buses


def _asked(
    buses: list[ZenohBus], arguments: argparse.Namespace, routers: dict[str, int]
) -> tuple[int, int, dict[str, float]]:
    """Return how many were asked, how many stayed without an answer, and what each router took meanwhile."""
    ask_until_served(buses[0], KEYS.answer("s0", "ann"))
    begun_s = {name: cpu_s(pid) for name, pid in routers.items()}
    answers: list[Reply | None] = []
    payload, pause = bytes(ANSWER_BYTES), threading.Event()
    total = int(arguments.rate * arguments.seconds)
    begun = time.monotonic()
    for number in range(total):
        pause.wait(max(0.0, begun + number / arguments.rate - time.monotonic()))
        index = number % len(buses)
        buses[index].ask(KEYS.answer(f"s{index}", "ann"), payload, answers.append, 2_000)
    while len(answers) < total:
        pause.wait(0.01)
    used_s = {name: cpu_s(pid) - begun_s[name] for name, pid in routers.items()}
    return total, sum(answer is None for answer in answers), used_s


def main() -> None:
    """Measure each way and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default in (("rate", 500), ("seconds", 8), ("clients", 100), ("idle", 400)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="sfid-links-") as name:
        folder = certified(Path(name) / "access", "router", "edge", "learner", "teacher")
        results = [measure(way, arguments, folder) for way in ("clear", "tls", "edge")]
    if arguments.json:
        print(json.dumps({each.way: vars(each) for each in results}))
        return
    print(f"{arguments.rate} labels a second of {arguments.clients} clients: us a label, kB a further client")
    for each in results:
        costs = ", ".join(
            f"{name} {each.router_us[name]:.0f} us {each.client_kb[name]:.0f} kB" for name in each.router_us
        )
        print(f"{each.way:6} {costs}; {each.lost} of {each.labels} lost")


if __name__ == "__main__":
    main()
