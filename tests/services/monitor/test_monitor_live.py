"""The monitor with viewers: late ones, frozen ones, and the web page."""

import http.client
import signal
import socket
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from protocol.messages import Episode
from services.monitor.config import LOOPBACK, Addresses, MonitorError, free_port
from services.monitor.live import Live
from services.monitor.rows import Document, Moment, Row, Rows
from services.monitor.service import MonitorConfig
from services.monitor.web import viewer_program
from tests.services.monitor.feeder import Lesson
from tests.services.monitor.rrd_rows import rows_of
from tests.services.monitor.test_monitor_service import DEADLINE_S, PIXELS, SCALARS, Running

pytestmark = pytest.mark.real


@pytest.fixture
def monitor() -> Iterator[Running]:
    running = Running(MonitorConfig(scene_port=0, curves_port=0, web_port=0))
    yield running
    running.stop()


def addresses_of(running: Running) -> Addresses:
    """The ports, as the lines for people tell them."""
    browser, native = running.where.split("\n")
    curves_url, scene_url = native.split(" --connect ")[1].split(" ")
    ports = [int(url.removesuffix("/proxy").rsplit(":", 1)[1]) for url in (scene_url, curves_url)]
    return Addresses(ports[0], ports[1], int(browser.split("/?")[0].rsplit(":", 1)[1]))


class SavingViewer:
    """A viewer without a window that writes what it is shown to a file."""

    def __init__(self, path: Path, addresses: Addresses) -> None:
        urls = [addresses.curves_url, addresses.scene_url]
        command = [
            str(viewer_program()),
            "--save",
            str(path),
            "--port",
            str(free_port(set())),
            "--bind",
            LOOPBACK,
            *urls,
        ]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.path = path

    def end(self) -> None:
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(DEADLINE_S)
        finally:
            self.process.kill()
            self.process.wait()

    def seen(self) -> tuple[list[int], bool]:
        """The episodes whose curves have arrived so far, and whether a picture has."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the file is still being written and has no footer
            try:
                episodes = [at["episode"] for at, _ in rows_of(self.path, "curves/steps", SCALARS)]
                return episodes, bool(rows_of(self.path, "world", PIXELS))
            except (OSError, RuntimeError, ValueError):
                return [], False


def eventually(condition: Callable[[], bool]) -> None:
    """Wait for another process, looking again and again until the deadline."""
    pause = threading.Event()
    for _ in range(int(DEADLINE_S * 10)):
        if condition():
            return
        pause.wait(0.1)
    pytest.fail("it did not come true in time")


def fetch(port: int, path: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection(LOOPBACK, port, timeout=DEADLINE_S)
    connection.request("GET", path)
    return connection.getresponse()


def test_the_page_is_served_on_loopback_and_may_call_only_our_servers(monitor: Running) -> None:
    addresses = addresses_of(monitor)
    assert addresses.web_port is not None
    page = fetch(addresses.web_port, "/")
    policy = page.headers["Content-Security-Policy"]
    servers = f"http://{LOOPBACK}:{addresses.scene_port} http://{LOOPBACK}:{addresses.curves_port}"
    assert f"connect-src 'self' {servers};" in policy
    assert b"re_viewer.js" in page.read()
    wasm = fetch(addresses.web_port, "/re_viewer_bg.wasm")
    assert wasm.headers["Content-Type"] == "application/wasm"
    assert wasm.read(4) == b"\0asm"
    wasm.close()
    assert fetch(addresses.web_port, "/../secret").status == 404


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="reads Linux's table of sockets")
def test_every_port_is_on_loopback_only(monitor: Running) -> None:
    addresses = addresses_of(monitor)
    table = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = {int(row[1].split(":")[1], 16): row[1].split(":")[0] for row in table if row[3] == "0A"}
    ports = (addresses.scene_port, addresses.curves_port, addresses.web_port)
    assert [listening[port] for port in ports if port] == ["0100007F"] * 3


@pytest.mark.parametrize("field", ["scene_port", "curves_port"])
def test_a_port_that_is_taken_at_the_last_moment_is_named(field: str) -> None:
    scene = free_port(set())
    with socket.create_server((LOOPBACK, 0)) as taken:
        port = taken.getsockname()[1]
        addresses = Addresses(port, scene, None) if field == "scene_port" else Addresses(scene, port, None)
        with pytest.raises(MonitorError) as caught:
            Live(addresses)
    assert str(caught.value).startswith(
        f"cannot serve viewers at {LOOPBACK}:{port} ({field}): another program"
    )


def test_a_late_viewer_sees_the_whole_past(monitor: Running, tmp_path: Path) -> None:
    monitor.publish(*Lesson(episodes=3).messages())
    viewer = SavingViewer(tmp_path / "seen.rrd", addresses_of(monitor))
    try:
        eventually(lambda: viewer.seen() == ([0, 1, 2], True))
    finally:
        viewer.end()
    assert viewer.seen() == ([0, 1, 2], True)


def test_how_things_stand_comes_with_the_pictures_and_leaves_the_server_of_curves_to_the_curves(
    tmp_path: Path,
) -> None:
    scene_port = free_port(set())
    addresses = Addresses(scene_port, free_port({scene_port}), web_port=None)
    live = Live(addresses)
    scene = SavingViewer(tmp_path / "scene.rrd", replace(addresses, curves_port=scene_port))
    curves = SavingViewer(tmp_path / "curves.rrd", replace(addresses, scene_port=addresses.curves_port))

    def texts(viewer: SavingViewer) -> dict[str, list[Any]]:
        with suppress(OSError, RuntimeError, ValueError), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the file is still being written
            return {
                entity: [text for _, (text,) in rows_of(viewer.path, entity, "TextDocument:text")]
                for entity in ("now", "episodes")
            }
        return {}

    try:
        rows: list[Row] = [Document(name, Moment(1), name) for name in ("now", "episodes")]
        live.show("told", Rows(curves=rows))
        eventually(lambda: bool(texts(scene).get("now")) and bool(texts(curves).get("episodes")))
        assert {name for name, found in texts(scene).items() if found} == {"now"}
        assert {name for name, found in texts(curves).items() if found} == {"episodes"}
    finally:
        scene.end()
        curves.end()
        live.close(DEADLINE_S)


def test_a_stopped_viewer_never_stops_another(monitor: Running, tmp_path: Path) -> None:
    stopped, awake = (
        SavingViewer(tmp_path / f"{name}.rrd", addresses_of(monitor)) for name in ("stopped", "awake")
    )
    try:
        messages = list(Lesson(episodes=6).messages())
        ends = [number for number, each in enumerate(messages) if isinstance(each, Episode)]
        monitor.publish(*messages[: ends[1] + 1])
        eventually(lambda: stopped.seen()[0] == awake.seen()[0] == [0, 1])
        stopped.process.send_signal(signal.SIGSTOP)
        for end, after in pairwise(ends[1:]):
            monitor.publish(*messages[end + 1 : after + 1])
        eventually(lambda: awake.seen()[0] == list(range(6)))
        assert stopped.seen()[0] == [0, 1]
        stopped.process.send_signal(signal.SIGCONT)
        eventually(lambda: stopped.seen()[0] == list(range(6)))
    finally:
        stopped.process.send_signal(signal.SIGCONT)
        stopped.end()
        awake.end()


FROZEN = """
import sys, threading
from services.monitor.service import MonitorConfig, run
from services.runtime.memory_bus import MemoryBus, MemoryHub
from pathlib import Path
from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Decision
from tests.services.monitor.feeder import Lesson

hub, stop = MemoryHub(inline=True), threading.Event()
mine = MemoryBus(hub)
def feed():
    for message in Lesson(episodes=3).messages():
        key = Keys().decision if isinstance(message, Decision) else Keys().measures
        mine.publish(key(message.session), encode(message))
    print("fed", flush=True)
    sys.stdin.readline()
    stop.set()
def ready(where):
    print(where.replace(chr(10), " "), flush=True)
    threading.Thread(target=feed, daemon=True).start()
config = MonitorConfig(recording_dir=Path(sys.argv[1]), scene_port=0, curves_port=0, web_port=None)
run(config, MemoryBus(hub), ready, stop)
"""


def test_with_a_frozen_viewer_the_process_ends_in_time_and_its_recording_is_whole(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", FROZEN, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    where = process.stdout.readline()
    curves_url, scene_url = where.split(" --connect ")[1].split(" ")[:2]
    command = [
        str(viewer_program()),
        "--save",
        str(tmp_path / "seen"),
        "--port",
        str(free_port(set())),
        "--bind",
        LOOPBACK,
    ]
    viewer = subprocess.Popen(
        [*command, curves_url, scene_url], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        viewer.send_signal(signal.SIGSTOP)
        assert process.stdout.readline() == "fed\n"
        process.stdin.write("stop\n")
        process.stdin.flush()
        assert process.wait(5.0 + 1.0) == 0
    finally:
        viewer.kill()
        viewer.wait()
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()
    verify = [str(viewer_program()), "rrd", "verify", str(tmp_path / "lesson.rrd")]
    assert subprocess.run(verify, capture_output=True, check=False).returncode == 0
    assert len(rows_of(tmp_path / "lesson.rrd", "curves/steps", SCALARS)) == 3
