"""What the service benchmarks share: real services, bare Zenoh peers beside them, and figures."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from protocol.keys import Keys
from protocol.messages import CreateSession, WindowSpec, World
from services.cli.shared import launch
from services.operator import Operator
from services.router import free_endpoint
from services.runtime.signals import Stop
from services.runtime.zenoh_bus import ZenohBus
from services.supervisor import Supervisor
from services.topology import Role
from sfid_core.sokoban.levels import packaged

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Rig:
    """Running services and a bus to reach them."""

    endpoint: str
    data: Path
    bus: ZenohBus
    keys: Keys
    operator: Operator


@contextmanager
def running() -> Iterator[tuple[launch.Deployed, Supervisor, ZenohBus]]:
    """Yield real services in processes of their own, with a fresh data directory, and an operator's bus.

    The router asks nobody who they are, because bare peers beside the services use keys of their own.
    """
    with tempfile.TemporaryDirectory(prefix="sfid-bench-") as name, ExitStack() as stack:
        deployed = launch.Deployed(Path(name), free_endpoint(), "bench", guarded=False)
        supervisor = launch.supervise(deployed.data, launch.make_directories(deployed.data), Stop())
        stack.callback(supervisor.stop)
        supervisor.start(launch.router(deployed))
        supervisor.start(launch.environment(deployed), launch.learner(deployed))
        bus = launch.bus(deployed, Role.OPERATOR)
        stack.callback(bus.close)
        yield deployed, supervisor, bus


@contextmanager
def services() -> Iterator[Rig]:
    """Yield what runs, as most benchmarks use it."""
    with running() as (deployed, _, bus):
        keys = Keys(deployed.deployment)
        yield Rig(deployed.endpoint, deployed.data, bus, keys, Operator(bus, keys))


@contextmanager
def bare(endpoint: str, *roles: str) -> Iterator[None]:
    """Run bare Zenoh processes on the same router."""
    processes = [
        subprocess.Popen(
            [sys.executable, str(HERE / "bare.py"), role, endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        for role in roles
    ]
    try:
        for process in processes:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
        yield
    finally:
        for process in processes:
            assert process.stdin is not None
            process.stdin.close()
            process.wait(10)


def session_config(name: str, window: WindowSpec, episodes: int, teachers_min: int = 1) -> CreateSession:
    """Return a session on the packaged room."""
    world = World(level=packaged("room")[0].to_xsb(), level_name="room")
    return CreateSession(
        session=name, world=world, episodes=episodes, window=window, teachers_min=teachers_min
    )


def percentile(values: Sequence[float], share: float) -> float:
    """Return the value below which that share of the values lies."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def sync_seconds(path: Path, syncs: int) -> float:
    """Return the time of `syncs` appends of 400 bytes with fdatasync, as a journal's commit performs them."""
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    try:
        start = time.perf_counter()
        for _ in range(syncs):
            os.write(fd, b"x" * 400)
            os.fdatasync(fd)
        return time.perf_counter() - start
    finally:
        os.close(fd)


def disk_kind(path: Path) -> str:
    """Return the file system's type and device behind a path."""
    best = ("", "unknown")
    for line in Path("/proc/mounts").read_text().splitlines():
        device, mount, kind = line.split()[:3]
        if str(path.resolve()).startswith(mount) and len(mount) >= len(best[0]):
            best = (mount, f"{kind} on {device}")
    return best[1]


def print_result(result: dict[str, object], *, as_json: bool) -> None:
    """Print the figures as one JSON document or line by line."""
    if as_json:
        print(json.dumps(result))
        return
    for name, value in result.items():
        print(f"{name:>36}: {value:.6g}" if isinstance(value, float) else f"{name:>36}: {value}")
