"""Packets dropped by the kernel in a network namespace of the test's own: loss, and partitions."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from services.runtime.journal import read_rows, verify
from tests.services.cli.command_line import SFID, wait_for
from tests.services.faults_network.conftest import Tell

pytestmark = [pytest.mark.real, pytest.mark.timeout(240)]

PORT = 7_447
LOSS_PERCENT = 20
SENT_AGAIN = Path("/proc/sys/net/ipv4/tcp_rto_min_us")
MACHINES = Path(__file__).parents[3] / "MACHINES.md"
P99_MS = 1_000.0
PARTITION_S = 4.0
"""Over the lease of 2.5 s."""
BACK_S = 10.0

TEACH = """
import json, sys, threading
from contextlib import ExitStack
from pathlib import Path
from tests.services.faults_network.rig import Rig, acknowledged

root, session = Path(sys.argv[1]), sys.argv[2]
rig = Rig(root / "data", root / "access", "tcp/127.0.0.1:7447", None, None, ExitStack())
rig.create(session)
with rig.teaching(session, 2) as voices:
    leave = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), leave.set()), daemon=True).start()
    while not leave.wait(0.05):
        print(acknowledged(voices), flush=True)
told = {key.hex(): state.value for voice in voices for key, (state, _) in voice.acknowledged.items()}
waited = [each for voice in voices for each in voice.waited_ms]
print(json.dumps({"told": told, "waited_ms": waited, "left": sum(voice.unacknowledged for voice in voices)}))
"""


def _may() -> bool:
    if os.geteuid() or not (shutil.which("ip") and shutil.which("nft")):
        return False
    probe = ["unshare", "--net", "nft", "add", "table", "inet", "probe"]
    return subprocess.run(probe, capture_output=True, check=False).returncode == 0


pytestmark.append(pytest.mark.skipif(not _may(), reason="network namespaces and nftables need root"))


@dataclass
class Island:
    """A network namespace with a deployment in it, reached by its own loopback only."""

    name: str
    root: Path
    stack: ExitStack

    def run(self, *command: str) -> None:
        subprocess.run(["ip", "netns", "exec", self.name, *command], check=True, capture_output=True)

    def popen(self, *command: str, **pipes: Any) -> "subprocess.Popen[str]":  # noqa: ANN401 - as Popen's
        process = subprocess.Popen(["ip", "netns", "exec", self.name, *command], text=True, **pipes)
        self.stack.callback(process.wait)
        self.stack.callback(process.kill)
        return process

    def service(self, role: str, *arguments: str) -> "subprocess.Popen[str]":
        log = self.root / f"{role}.log"
        where = "--listen" if role == "router" else "--connect"
        common = (where, f"tcp/127.0.0.1:{PORT}", "--access", str(self.root / "access"))
        with log.open("w") as errors:
            process = self.popen(sys.executable, SFID, role, *common, *arguments, stderr=errors)
        wait_for(f"{role} is ready", lambda: " ready" in log.read_text(), 60.0)
        return process

    def drop(self, match: str) -> None:
        """Have the kernel drop what matches from now on."""
        self.run("nft", f"add rule inet weather input tcp {match} drop")

    def calm(self) -> None:
        """Let everything pass again."""
        self.run("nft", "flush", "chain", "inet", "weather", "input")


@contextmanager
def deployed(root: Path, *settings: str) -> Iterator[Island]:
    """Have a deployment in a namespace of its own, of a kernel set so."""
    name = f"sfid-{os.getpid()}-{root.name}"
    with ExitStack() as stack:
        subprocess.run(["ip", "netns", "add", name], check=True)
        stack.callback(subprocess.run, ["ip", "netns", "delete", name], check=True)
        made = Island(name, root, stack)
        made.run("ip", "link", "set", "lo", "up")
        made.run("nft", "add table inet weather")
        made.run("nft", "add chain inet weather input { type filter hook input priority 0 ; }")
        for setting in settings:
            made.run("sysctl", "-w", setting)
        processes = [
            made.service("router"), made.service("environment"),
            made.service("learner", "--data", str(root / "data")),
        ]  # fmt: skip
        yield made
        for process in reversed(processes):
            process.terminate()
            assert process.wait(15) == 0
    assert verify(root / "data").ok


@pytest.fixture(scope="module")
def island(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Island]:
    with deployed(tmp_path_factory.mktemp("island")) as made:
        yield made


@dataclass
class Taught:
    """What two teachers were told, and how long each acknowledgement took."""

    told: dict[str, str]
    waited_ms: list[float]
    left: int


def teach(island: Island, session: str, meanwhile: Callable[[Callable[[], int]], None]) -> Taught:
    """Have two teach in the namespace while something happens to it; return what they were told."""
    process = island.popen(
        sys.executable, "-c", TEACH, str(island.root), session, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        cwd=Path(__file__).parents[3],
    )  # fmt: skip
    assert process.stdin is not None
    assert process.stdout is not None
    lines, out = ["0"], process.stdout
    reader = threading.Thread(target=lambda: lines.extend(iter(out.readline, "")), daemon=True)
    reader.start()

    def count() -> int:
        return int(lines[-1]) if lines[-1].strip().isdigit() else 0

    wait_for("teaching has begun", lambda: count() > 6, 60.0)
    meanwhile(count)
    process.stdin.close()
    assert process.wait(60) == 0
    reader.join(10)
    out.close()
    return Taught(**json.loads(lines[-1]))


def lost_and_twice(island: Island, session: str, taught: Taught) -> tuple[int, int]:
    rows = [row.unique.hex() for row in read_rows(island.root / "data", session) if row.unique is not None]
    return len(set(taught.told) - set(rows)), len(rows) - len(set(rows))


def taught_under_loss(island: Island, session: str, labels: int) -> Taught:
    """Have so many labels and more acknowledged while every link loses packets, both ways."""

    def lose(count: Callable[[], int]) -> None:
        before = count()
        island.drop(f"dport {PORT} numgen random mod 100 < {LOSS_PERCENT}")
        island.drop(f"sport {PORT} numgen random mod 100 < {LOSS_PERCENT}")
        try:
            wait_for("teaching goes on", lambda: count() >= before + labels, 120.0)
        finally:
            island.calm()

    return teach(island, session, lose)


def percentile_ms(taught: Taught, share: float) -> float:
    """Return the waiting time that this share of the labels did not exceed (nearest rank)."""
    waited = sorted(taught.waited_ms)
    return waited[math.ceil(share * len(waited)) - 1]


def test_with_a_fifth_of_all_packets_lost_every_label_is_acknowledged_in_the_end(
    island: Island, tell: Tell
) -> None:
    taught = taught_under_loss(island, "loss", 40)
    assert (lost_and_twice(island, "loss", taught), taught.left) == ((0, 0), 0)
    tell(
        f"F12 {LOSS_PERCENT} % of packets lost on every link",
        "all labels acknowledged in the end",
        len(taught.told),
        "labels",
        f"0 lost, 0 twice, p90 {percentile_ms(taught, 0.9):.0f} ms, worst {max(taught.waited_ms):.0f} ms",
    )


@pytest.mark.skipif(not SENT_AGAIN.exists(), reason="a kernel before Linux 6.11 has no such setting")
def test_with_a_kernel_that_sends_again_after_20_ms_a_fifth_of_all_packets_lost_costs_less_than_a_second(
    tmp_path: Path, tell: Tell
) -> None:
    told = re.search(r"sysctl -w (net\.ipv4\.tcp_rto_min_us=(\d+))", MACHINES.read_text())
    assert told is not None, "MACHINES.md gives the setting"
    setting, soon_us = told.groups()
    with deployed(tmp_path, setting) as island:
        taught = taught_under_loss(island, "soon", 200)
        assert (lost_and_twice(island, "soon", taught), taught.left) == ((0, 0), 0)
    p99_ms = percentile_ms(taught, 0.99)
    assert p99_ms <= P99_MS
    tell(
        f"F12 {LOSS_PERCENT} % of packets lost on every link, sent again after {int(soon_us) // 1_000} ms",
        f"p99 at most {P99_MS:.0f} ms",
        len(taught.told),
        "labels",
        f"0 lost, 0 twice, p99 {p99_ms:.0f} ms, worst {max(taught.waited_ms):.0f} ms",
    )


@pytest.mark.parametrize(
    "way, matches",
    [("both ways", ("dport", "sport")), ("to the router", ("dport",)), ("from the router", ("sport",))],
)
def test_when_every_packet_is_dropped_for_a_while_nothing_is_lost_and_all_come_back(
    island: Island, tell: Tell, way: str, matches: tuple[str, ...]
) -> None:
    back_s: list[float] = []

    def cut_off(count: Callable[[], int]) -> None:
        for match in matches:
            island.drop(f"{match} {PORT}")
        try:
            threading.Event().wait(PARTITION_S)
            before = count()
        finally:
            island.calm()
        watch = threading.Event()
        while count() < before + 4:
            back_s.append(0.02)
            assert sum(back_s) < BACK_S, f"back within {BACK_S} s"
            watch.wait(0.02)

    session = "apart-" + matches[0] + str(len(matches))
    taught = teach(island, session, cut_off)
    assert (lost_and_twice(island, session, taught), taught.left) == ((0, 0), 0)
    tell(
        f"F8 all packets {way} dropped for {PARTITION_S:.0f} s",
        "back within 10 s",
        len(taught.told),
        "labels",
        f"0 lost, 0 twice, back after about {sum(back_s):.1f} s",
    )
