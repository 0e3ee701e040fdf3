"""Make the monitor's pictures: the native viewer on a virtual display, and the web viewer in Chromium.

    .venv/bin/python tests/benchmarks/monitor_screenshots.py [--out services/monitor] [--only native|web]

Six sessions are taught by scripts; what a viewer is sent of the first goes into a recording, and the native
viewer is photographed with each tab in front. The web viewer is photographed at a monitor that runs here.
Needs Xvfb and Chromium; exits 1 when a picture does not come out.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import rerun as rr
from PIL import Image

from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Decision, Episode, Step
from services.monitor.blueprint import blueprint
from services.monitor.config import LOOPBACK, free_port
from services.monitor.overview import draw_overview, glance
from services.monitor.service import MonitorConfig, run
from services.monitor.session_view import SessionView
from services.monitor.web import viewer_program
from services.monitor.writer import Writer, stream
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.browser.chromium import chromium
from tests.services.monitor.feeder import Lesson

SIZE = (1600, 900)
DISPLAY = ":97"
TEACHERS = (("ada", 0.95), ("ben", 0.8), ("cyd", 0.55))
STEP_S = 0.25
SETTLE_S = 15.0
"""A browser that draws without a graphics card takes this long to catch up."""
PAUSE = threading.Event()
START_S = 60.0
FIRST = "monday-group"
ENDED_S = 100_000.0
WAITED_S = {"solo": 240.0, "pilot-8": 4.0}
"""How long ago the learner of a session said something."""
PNG_BYTES_MAX = 300_000
TABS = ("monitor", "teachers", "overview", "episodes")
"""Names of the pictures, by tab."""

Message = Decision | Step | Episode


def lessons() -> dict[str, list[Message]]:
    """Messages of six sessions: one goes badly, one is done, one has nobody who answers."""
    told = {}
    for number, name in enumerate(("monday-group", "night-shift", "pilot-7", "pilot-8", "solo", "workshop")):
        teachers = TEACHERS if number in {0, 5} else TEACHERS[number % 3 : number % 3 + 1 + number % 2]
        lesson = Lesson(
            session=name, episodes=40 - 5 * number, teachers=() if name == "night-shift" else teachers,
            seed=7 + number, steps_max=12 if name == "pilot-8" else 120,
        )  # fmt: skip
        messages = list(lesson.messages())
        told[name] = messages if name == "workshop" else messages[: -len(messages) // 8]
    return told


def last_spoken(messages: list[Message]) -> list[Message]:
    """Cut the messages before the last step on which everybody spoke; return it and the decision after it."""
    at = len(messages) - 1
    while not (isinstance(step := messages[at], Step) and len(step.said) == 3 and step.outcome == "running"):
        at -= 1
    last = messages[at : at + 2]
    del messages[at:]
    return last


def write(writer: Writer, view: SessionView, now_s: float) -> None:
    """Write what viewers are sent now."""
    due = view.tick(now_s)
    for row in (*due.live.scene, *due.live.curves):
        writer.write(row)


def record(path: Path, tab: int) -> None:
    """Write what a viewer of the first session is sent, with that tab in front."""
    recording = stream("local-monday-group", 0.5, send_properties=True)
    recording.set_sinks(rr.FileSink(path, write_footer=True))
    recording.send_blueprint(blueprint(tab), make_active=True, make_default=True)
    writer = Writer(recording)
    writer.style_curves()
    views = {}
    for name, messages in lessons().items():
        view = views[name] = SessionView(0.0)
        now_s = 0.0
        last = last_spoken(messages) if name == FIRST else []
        for message in messages:
            view.take(message, now_s)
            now_s += STEP_S / 2 if isinstance(message, Decision) else 0.0
            write(writer, view, now_s) if name == FIRST else view.tick(now_s)
            if message is messages[0]:
                recording.flush(timeout_sec=10)  # every entity early: a viewer takes a frame for each new one
        for message in last:
            view.take(message, now_s + 10.0)
        view.decided_s = ENDED_S - WAITED_S.get(name, 0.0)
    first = views[FIRST]
    write(writer, first, ENDED_S + 0.1)
    recording.flush(timeout_sec=10)  # what stands in the texts comes early in the file: a viewer is quick
    glances = [glance(name, view, ENDED_S) for name, view in sorted(views.items())]
    writer.write(draw_overview(glances, first.chronicle.moment))
    recording.flush(timeout_sec=10)
    recording.disconnect()


@contextmanager
def display() -> Iterator[dict[str, str]]:
    """A virtual display, as environment for the viewer."""
    # Larger than the window, so that the pointer, which rests in the middle, is beside it.
    screen = f"{SIZE[0] * 5}x{SIZE[1] * 5}x24"
    process = subprocess.Popen(
        ["Xvfb", DISPLAY, "-screen", "0", screen, "-nolisten", "tcp"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        PAUSE.wait(1.0)
        yield {**os.environ, "DISPLAY": DISPLAY, "WGPU_BACKEND": "vulkan"}
    finally:
        process.terminate()
        process.wait()


def native(path: Path, source: list[str], wait_s: float) -> bool:
    """Photograph the native viewer; tell whether a picture came out."""
    with display() as environment, tempfile.TemporaryDirectory() as home:
        command = [
            str(viewer_program()), *source, "--screenshot-to", str(path),
            "--window-size", f"{SIZE[0]}x{SIZE[1]}", "--port", str(free_port(set())), "--bind", LOOPBACK,
            "--hide-welcome-screen",
        ]  # fmt: skip
        process = subprocess.Popen(
            command, env={**environment, "HOME": home, "RUST_LOG": "off"},
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )  # fmt: skip
        try:
            process.wait(wait_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                process.wait(5)
        finally:
            process.kill()
            _, said = process.communicate()
        if not path.exists():
            print(said.decode(errors="replace")[-2000:], file=sys.stderr)
    return path.exists()


def small(path: Path) -> None:
    """Bring a picture to the size of the window, and to few enough bytes: a README loads it every time."""
    with Image.open(path) as picture:
        shrunk = picture.convert("RGB").resize(SIZE, Image.Resampling.LANCZOS)
    shrunk.save(path, optimize=True)
    if path.stat().st_size > PNG_BYTES_MAX:
        shrunk.quantize(256, kmeans=1, dither=Image.Dither.NONE).save(path, optimize=True)


class Running:
    """A monitor in this process, fed from here."""

    def __init__(self) -> None:
        hub = MemoryHub(inline=True)
        self._stop, self._ready = threading.Event(), threading.Event()
        self.where = ""
        self._bus = MemoryBus(hub)
        config = MonitorConfig(scene_port=0, curves_port=0, web_port=0)
        self._thread = threading.Thread(
            target=run,
            args=(config, MemoryBus(hub), self._say, self._stop),
            kwargs={"leave": lambda _: None},
            daemon=True,
        )
        self._thread.start()
        self._ready.wait(START_S)

    def _say(self, where: str) -> None:
        self.where = where
        self._ready.set()

    def publish(self, message: Message) -> None:
        """Say what a learner says."""
        keys = Keys()
        key = keys.decision if isinstance(message, Decision) else keys.measures
        self._bus.publish(key(message.session), encode(message))

    def close(self) -> None:
        """End it."""
        self._stop.set()
        self._thread.join(START_S)


def web(path: Path) -> bool:
    """Photograph the web viewer; tell whether a picture came out."""
    monitor = Running()
    try:
        messages = lessons()[FIRST]
        for message in messages[:-120]:
            monitor.publish(message)
        url = monitor.where.split("\n")[0].split(": ", 1)[1]
        with chromium() as browser:
            tab = browser.tab(browser.person(), SIZE)
            tab.open(url + "&renderer=webgl")
            for message in messages[-120:]:
                monitor.publish(message)
                PAUSE.wait(STEP_S)
            PAUSE.wait(SETTLE_S)
            tab.screenshot(path)
            tab.close()
    finally:
        monitor.close()
    return path.exists()


def main() -> int:
    """Make the pictures; return 1 when one is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("services/monitor"))
    parser.add_argument("--only", choices=("native", "web"))
    parser.add_argument("--tab", type=int, choices=range(len(TABS)))
    asked = parser.parse_args()
    made = {}
    with tempfile.TemporaryDirectory() as folder:
        for tab, name in enumerate(TABS):
            if asked.only != "web" and asked.tab in {None, tab}:
                source = Path(folder, f"{name}.rrd")
                record(source, tab)
                made[name] = native(asked.out / f"{name}.png", [str(source)], START_S)
    if asked.only != "native":
        made["web"] = web(asked.out / "web.png")
    for name, done in made.items():
        if done:
            small(asked.out / f"{name}.png")
        size = (asked.out / f"{name}.png").stat().st_size if done else 0
        print(f"{asked.out / name}.png: {size} bytes" if done else f"{name}: no picture")
    return 0 if all(made.values()) else 1


if __name__ == "__main__":
    raise SystemExit(main())
