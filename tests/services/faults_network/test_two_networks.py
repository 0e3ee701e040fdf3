"""MACHINES.md as it stands: two networks with addresses of their own, a link that is cut and comes back."""

import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from services.runtime.journal import read_rows, verify
from tests.services.cli.command_line import SFID, wait_for
from tests.services.faults_network.conftest import Tell


def _may() -> bool:
    if os.geteuid() or not (shutil.which("ip") and shutil.which("nft") and shutil.which("openssl")):
        return False
    probe = ["unshare", "--net", "nft", "add", "table", "inet", "probe"]
    return subprocess.run(probe, capture_output=True, check=False).returncode == 0


pytestmark = [
    pytest.mark.real,
    pytest.mark.timeout(120),
    pytest.mark.skipif(not _may(), reason="network namespaces and nftables need root"),
]
ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "MACHINES.md").read_text(encoding="utf-8")
CUT_S = 3.0
"""Over the lease of 2.5 s: both routers know that the link is gone."""
BACK_S = 10.0
LAB = "tls/192.0.2.7:7447"
LABELS = 20
"""Acknowledged before the cut, and again after it."""
TEACH = """
import json, sys, threading
from pathlib import Path
from protocol.keys import Keys
from services.client import AnswerState, AnswerUpdate, Client, Opened
from services.outbox import Outbox
from services.runtime.access import access_for
from services.runtime.clock import SystemClock
from services.runtime.zenoh_bus import open_bus
from services.teachers.token_file import read_check_key, read_token

endpoint, folder, token = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
bus = open_bus(endpoint, 15_000, access=access_for(endpoint, "teacher", folder))
leave, told = threading.Event(), {}
threading.Thread(target=lambda: (sys.stdin.read(), leave.set()), daemon=True).start()


def hear(client, update):
    match update:
        case Opened(decision) if decision.phase == "asking" and not client.has_answered(decision):
            client.answer(decision, action=decision.actions[decision.decision % 4])
        case AnswerUpdate(answer_id=key, state=AnswerState.SAVED | AnswerState.TOO_LATE as state):
            told[key.hex()] = state.value
            print(len(told), flush=True)


with Client(
    bus, Keys(), "maze", "ann", outbox=Outbox(), clock=SystemClock(),
    token=read_token(token), check_key=read_check_key(token),
) as client:
    while not leave.is_set():
        hear(client, client.next(0.05))
    left = client.drain(10.0)
bus.close()
print(json.dumps({"told": told, "left": left}))
"""


def commands(heading: str) -> list[str]:
    """The blocks of commands below a heading of the page."""
    part = PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    blocks, block = [], list[str]()
    for line in [*part.splitlines(), ""]:
        if line.startswith("    "):
            block.append(line[4:])
        elif block:
            blocks.append("\n".join(block))
            block = []
    return blocks


@dataclass
class Machines:
    """The lab, the town, and what lies between: a network namespace each."""

    root: Path
    stack: ExitStack
    tag: str

    def name(self, place: str) -> str:
        return f"sfid-{place}-{self.tag}"

    def run(self, place: str, command: str) -> None:
        inside = ["ip", "netns", "exec", self.name(place), "bash", "-ec", command]
        subprocess.run(inside, check=True, capture_output=True, cwd=self.root, env=self.environment())

    def start(self, place: str, *command: str, **pipes: Any) -> "subprocess.Popen[str]":  # noqa: ANN401 - as Popen's
        inside = ["ip", "netns", "exec", self.name(place), *command]
        process = subprocess.Popen(inside, text=True, cwd=self.root, env=self.environment(), **pipes)
        self.stack.callback(process.wait)
        self.stack.callback(process.kill)
        return process

    def service(self, place: str, command: str, ready: str) -> "subprocess.Popen[str]":
        log = self.root / f"{place}.log"
        with log.open("w") as out:
            process = self.start(place, *command.split(), stdout=out, stderr=subprocess.STDOUT)
        wait_for(f"{place} is ready", lambda: ready in log.read_text(), 60.0)
        return process

    def environment(self) -> dict[str, str]:
        """The page's `sfid` is this one, and its notes are the test's own."""
        path = f"{Path(SFID).parent}:{os.environ['PATH']}"
        return os.environ | {
            "PATH": path,
            "XDG_STATE_HOME": str(self.root / "state"),
            "PYTHONPATH": str(ROOT),
        }


def _wired(machines: Machines) -> None:
    """Give lab and town the page's addresses, in networks of their own, with a machine between them."""
    for place in ("lab", "town", "between"):
        name = machines.name(place)
        subprocess.run(["ip", "netns", "add", name], check=True)
        machines.stack.callback(subprocess.run, ["ip", "netns", "delete", name], check=True)
        machines.run(place, "ip link set lo up")
    for place, host, gateway in (
        ("lab", "192.0.2.7", "192.0.2.1"),
        ("town", "198.51.100.9", "198.51.100.1"),
    ):
        inside, between = machines.name(place), machines.name("between")
        link = [
            "ip",
            "-n",
            between,
            "link",
            "add",
            place,
            "type",
            "veth",
            "peer",
            "name",
            "eth0",
            "netns",
            inside,
        ]
        subprocess.run(link, check=True)
        machines.run("between", f"ip address add {gateway}/24 dev {place}; ip link set {place} up")
        machines.run(
            place,
            f"ip address add {host}/24 dev eth0; ip link set eth0 up; ip route add default via {gateway}",
        )
    machines.run("between", "echo 1 > /proc/sys/net/ipv4/ip_forward")
    machines.run(
        "between",
        "nft add table inet way; nft add chain inet way forward '{ type filter hook forward priority 0; }'",
    )


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[Machines]:
    with ExitStack() as stack:
        made = Machines(tmp_path, stack, str(os.getpid()))
        _wired(made)
        yield made


def test_a_session_is_taught_from_another_network_and_a_cut_link_loses_nothing(
    machines: Machines, tell: Tell
) -> None:
    root = machines.root
    machines.run("lab", commands("Certificates")[0])
    machines.run("lab", commands("What is exposed")[0])
    (root / "quiet.toml").write_text("[monitor]\nenabled = false\n")
    # The town starts first: it waits for the lab.
    town = machines.service("town", commands("The town")[0], " ready")
    lab = machines.service(
        "lab", f"{commands('The lab')[0]} --config quiet.toml", "router at tls/192.0.2.7:7447, data in lab\n"
    )
    linked = f"linked with {LAB}\n"
    wait_for("the edge says that its link stands", lambda: linked in (root / "town.log").read_text())
    assert f"no link to {LAB} yet, trying" in (root / "town.log").read_text().partition(linked)[0]
    machines.run("lab", commands("Does it work?")[0])
    create, key = commands("Teaching")[0].splitlines()
    machines.run("lab", f"{create} --episodes 100000")
    machines.run("lab", key)
    teacher = machines.start(
        "town", sys.executable, "-c", TEACH, "tls/198.51.100.9:7447", "town", "ann.token",
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    back_s, told, left = _taught_through_a_cut(machines, teacher)
    for process in (lab, town):
        process.terminate()
        assert process.wait(20) == 0
    kept = [row.unique.hex() for row in read_rows(root / "lab", "maze") if row.unique is not None]
    assert (set(told) - set(kept), len(kept) - len(set(kept)), left) == (set(), 0, 0)
    assert verify(root / "lab").ok
    assert back_s < BACK_S
    tell(
        f"F8 the link between two routers cut for {CUT_S:.0f} s",
        "back within 10 s",
        len(told),
        "labels",
        f"0 lost, 0 twice, back after {back_s:.1f} s",
    )


def _taught_through_a_cut(
    machines: Machines, teacher: "subprocess.Popen[str]"
) -> tuple[float, dict[str, str], int]:
    """Return how long after the link's return teaching went on, what the teacher was told, what is open."""
    assert teacher.stdin is not None
    assert teacher.stdout is not None
    lines, out = ["0"], teacher.stdout
    reader = threading.Thread(target=lambda: lines.extend(iter(out.readline, "")), daemon=True)
    reader.start()

    def count() -> int:
        return int(lines[-1])

    wait_for("teaching goes on", lambda: count() >= LABELS, 30.0)
    machines.run("between", "nft add rule inet way forward tcp dport 7447 drop")
    machines.run("between", "nft add rule inet way forward tcp sport 7447 drop")
    threading.Event().wait(CUT_S)
    before, pause, waited_s = count(), threading.Event(), 0.0
    machines.run("between", "nft flush chain inet way forward")
    while count() <= before and waited_s < BACK_S:
        pause.wait(0.05)
        waited_s += 0.05
    wait_for("teaching goes on again", lambda: count() >= before + LABELS, 20.0)
    teacher.stdin.close()
    assert teacher.wait(30) == 0
    reader.join(10)
    out.close()
    said = json.loads(lines[-1])
    return waited_s, said["told"], said["left"]
