"""The monitor as a service: messages in over a bus, a recording out, viewers optional."""

import math
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pytest
import rerun as rr

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import (
    CreateSession,
    Decision,
    Episode,
    LabelTotals,
    SessionList,
    SessionQuery,
    SessionReport,
    SessionSummary,
    Step,
    WindowSpec,
    World,
)
from protocol.status_message import ServiceStatus
from services.monitor.config import Addresses, viewer_command
from services.monitor.scene import TeacherColours, draw_world, frames_of_step
from services.monitor.service import MonitorConfig, MonitorCounts, MonitorError, run
from services.monitor.web import viewer_program
from services.runtime.bus import Reply, Request
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.monitor.feeder import ROOM, SOLUTION_ROOM, Lesson
from tests.services.monitor.rrd_rows import entities_of, rows_of
from tests.services.monitor.test_monitor_pictures import indexes_of

DEADLINE_S = 30.0
SCALARS = "Scalars:scalars"
PIXELS = "SegmentationImage:buffer"
PICTURES = ("world", "policy", "conflicts", "doubtful")
Message = Decision | Step | Episode


@pytest.fixture(autouse=True)
def _strict() -> Iterator[None]:
    """A value that Rerun would only warn about is an error here."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


class Running:
    """A monitor on a thread of its own, on a bus shared with the test."""

    def __init__(self, config: MonitorConfig, hub: MemoryHub | None = None) -> None:
        self.hub = hub or MemoryHub(inline=True)
        self._delivers = hub is None
        """Whether the bus delivers by itself; another's is delivered by whoever runs it."""
        self.bus = MemoryBus(self.hub)
        self.keys = Keys(config.deployment)
        self.where = ""
        self.left: list[int] = []
        self._config = config
        self._ready = threading.Event()
        self._stop = threading.Event()
        self._counts: list[MonitorCounts] = []
        self._errors: list[Exception] = []
        self._thread = threading.Thread(target=self._run, daemon=True)  # a test that fails leaves it behind
        self._thread.start()
        assert self._ready.wait(DEADLINE_S)
        if self._errors:
            raise self._errors[0]

    def publish(self, *messages: Message) -> None:
        for message in messages:
            key = self.keys.decision if isinstance(message, Decision) else self.keys.measures
            self.bus.publish(key(message.session), encode(message))

    def work_off(self) -> None:
        """Wait until everything that was published has been shown."""
        for _ in range(2):  # what was taken together with the first question is shown before the second
            while self.status().backlog:
                pass

    def status(self) -> ServiceStatus:
        replies: SimpleQueue[Reply | None] = SimpleQueue()
        self.bus.ask(self.keys.status("monitor", "0"), b"", replies.put, int(DEADLINE_S * 1000))
        reply = replies.get(timeout=DEADLINE_S)
        assert reply is not None
        return decode(reply.payload, ServiceStatus)

    def stop(self, *, worked_off: bool = True) -> MonitorCounts:
        if worked_off and self._delivers and not self._errors:
            self.work_off()
        self._stop.set()
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive()
        if self._errors:
            raise self._errors[0]
        return self._counts[0]

    def _run(self) -> None:
        def ready(where: str) -> None:
            self.where = where
            self._ready.set()

        try:
            bus = MemoryBus(self.hub)
            self._counts.append(run(self._config, bus, ready, self._stop, leave=self.left.append))
        except Exception as error:  # noqa: BLE001 - raised again by the test
            self._errors.append(error)
            self._ready.set()


def recorded(folder: Path, session: str | None = None) -> MonitorConfig:
    return MonitorConfig(recording_dir=folder, viewer=False, session=session)


def verified(path: Path) -> bool:
    command = [str(viewer_program()), "rrd", "verify", str(path)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def series(path: Path, entity: str) -> list[tuple[int, int, list[float]]]:
    return [(at["step"], at["episode"], values) for at, values in rows_of(path, entity, SCALARS)]


def test_the_recording_holds_every_episodes_curves_value_by_value(tmp_path: Path) -> None:
    monitor = Running(recorded(tmp_path))
    messages = list(Lesson(episodes=14).messages())
    monitor.publish(*messages)
    counts = monitor.stop()
    assert (counts.messages, counts.malformed, counts.dropped_messages) == (len(messages), 0, 0)
    path = tmp_path / "lesson.rrd"
    assert verified(path)
    told = [message for message in messages if isinstance(message, Episode)]
    steps = [episode.steps for episode in told]
    means = [math.fsum(steps[max(0, last - 9) : last + 1]) / min(10, last + 1) for last in range(14)]
    rows: dict[str, Callable[[Episode], list[float]]] = {
        "curves/steps": lambda e: [float(e.steps), means[e.episode], float(e.optimal_steps or 0)],
        "curves/td_error": lambda e: [e.abs_td_error, e.abs_td_error_shaped],
        "curves/return": lambda e: [e.discounted_return, e.discounted_env_return],
        "curves/inputs": lambda e: [float(e.inputs)],
    }
    for entity, row in rows.items():
        assert series(path, entity) == [(e.decision, e.episode, row(e)) for e in told], entity


def test_the_recording_holds_every_picture_that_was_drawn_and_ends_on_the_last(tmp_path: Path) -> None:
    monitor = Running(recorded(tmp_path))
    messages = list(Lesson(episodes=3).messages())
    monitor.publish(*messages)
    counts = monitor.stop()
    path = tmp_path / "lesson.rrd"
    pictures = {name: rows_of(path, name, PIXELS) for name in PICTURES}
    assert sum(map(len, pictures.values())) == counts.pictures
    last = [message for message in messages if isinstance(message, Step)][-1]
    ended = frames_of_step(last, last.at_ns)[-1]
    expected = draw_world(ended, TeacherColours())
    at, (pixels,) = pictures["world"][-1]
    assert (at["step"], at["episode"]) == (last.decision + 1, last.episode)
    assert bytes(pixels) == indexes_of(expected).tobytes()
    named = {f"{kind}/{name}" for kind in ("teachers", "reliability") for name in ("ada", "ben", "cyd")}
    curves = {f"curves/{name}" for name in ("steps", "td_error", "return", "inputs", "agreement")}
    assert entities_of(path) == {*PICTURES, "now", "events", "episodes", "doubts"} | named | curves


def test_the_event_log_tells_how_each_episode_ended(tmp_path: Path) -> None:
    monitor = Running(recorded(tmp_path))
    monitor.publish(*Lesson(room=SOLUTION_ROOM, episodes=2, teachers=()).messages())
    monitor.stop()
    texts = [values[0] for _, values in rows_of(tmp_path / "lesson.rrd", "events", "TextLog:text")]
    assert texts[0] == "watching: sfid, 2 episodes, now asking the teachers"
    assert [text.split(":")[0] for text in texts[1:3]] == ["episode 1 solved", "episode 2 solved"]
    assert texts[3:] == ["session finished"]


def test_malformed_messages_are_counted_told_and_survived(tmp_path: Path) -> None:
    monitor = Running(recorded(tmp_path))
    messages = list(Lesson(room=SOLUTION_ROOM, episodes=2).messages())
    monitor.publish(messages[0])
    monitor.bus.publish(monitor.keys.measures("lesson"), b"\xc1 not a message")
    monitor.bus.publish(monitor.keys.measures("lesson"), b"")
    monitor.bus.publish(monitor.keys.measures("other"), encode(messages[-2]))
    unreadable = Lesson(room=SOLUTION_ROOM, session="odd")
    odd = next(iter(unreadable.messages()))
    monitor.publish(
        *messages[1:], _with(odd, view="# no level at all".translate(dict.fromkeys(map(ord, "nolevat"), ".")))
    )
    counts = monitor.stop()
    assert (counts.malformed, counts.unreadable_views, counts.messages) == (3, 1, len(messages) + 1)
    assert len(series(tmp_path / "lesson.rrd", "curves/steps")) == 2
    levels = [values[0] for _, values in rows_of(tmp_path / "lesson.rrd", "events", "TextLog:level")]
    assert levels.count("WARN") == 2


def test_a_monitor_that_starts_anew_keeps_the_earlier_recording(tmp_path: Path) -> None:
    for _ in range(3):
        monitor = Running(recorded(tmp_path))
        monitor.publish(*Lesson(room=SOLUTION_ROOM, episodes=1).messages())
        monitor.stop()
    names = ["lesson.2.rrd", "lesson.3.rrd", "lesson.rrd"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert [len(series(tmp_path / name, "curves/steps")) for name in names] == [1, 1, 1]


def test_only_the_configured_session_is_recorded(tmp_path: Path) -> None:
    monitor = Running(recorded(tmp_path, "second"))
    for session in ("first", "second"):
        monitor.publish(*Lesson(session=session, room=SOLUTION_ROOM, episodes=1).messages())
    monitor.stop()
    assert [path.name for path in tmp_path.iterdir()] == ["second.rrd"]


def test_more_sessions_than_fit_end_the_quietest_recording_well(tmp_path: Path) -> None:
    monitor = Running(MonitorConfig(recording_dir=tmp_path, viewer=False, sessions_max=2, gives_way_s=0.0))
    for session in ("a", "b", "c"):
        monitor.publish(*Lesson(session=session, room=SOLUTION_ROOM, episodes=1).messages())
    monitor.stop()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.rrd", "b.rrd", "c.rrd"]
    assert all(verified(path) for path in tmp_path.iterdir())


def test_a_session_that_goes_on_gives_its_place_to_no_other(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    monitor = Running(MonitorConfig(recording_dir=tmp_path, viewer=False, sessions_max=2))
    lessons = [tuple(Lesson(session=name, room=SOLUTION_ROOM, episodes=1).messages()) for name in "abcd"]
    for together in zip(*lessons, strict=True):
        monitor.publish(*together)
    monitor.stop()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.rrd", "b.rrd"]
    assert all(series(path, "curves/steps") for path in tmp_path.iterdir())
    assert caplog.text.count("more sessions go on than the 2 that are shown") == 1


class Learner:
    """Answers what a monitor asks about the past, and holds back episodes from the topic."""

    def __init__(self, bus: MemoryBus, episodes: list[Episode]) -> None:
        self.asked: list[int] = []
        self._answered = threading.Condition()
        self._episodes = episodes
        bus.serve(Keys().learner("list"), self._list)
        bus.serve(Keys().learner("show"), self._show)

    def _list(self, request: Request) -> None:
        request.reply(encode(SessionList(sessions=(self._summary(),))))

    def _show(self, request: Request) -> None:
        first = decode(request.payload, SessionQuery).first_episode
        self.asked.append(first)
        report = SessionReport(
            summary=self._summary(),
            config=CreateSession(
                session="lesson", world=World(level=ROOM), window=WindowSpec(mode="early", span_ms=1)
            ),
            epoch=1,
            labels=LabelTotals(
                submitted=0, acknowledged=0, applied=0, superseded=0, late=0, rejected=0, pending=0
            ),
            teaching_ns=0,
            q_sha256="",
            first_episode=first,
            episodes=tuple(self._episodes[first : first + 100]),
        )
        request.reply(encode(report))
        with self._answered:
            self._answered.notify_all()

    def await_answers(self, count: int) -> None:
        with self._answered:
            assert self._answered.wait_for(lambda: len(self.asked) >= count, DEADLINE_S)

    def _summary(self) -> SessionSummary:
        return SessionSummary(
            session="lesson",
            method="sfid",
            level_name="room",
            phase="asking",
            paused=False,
            episode=len(self._episodes),
            episodes=400,
            decision=self._episodes[-1].decision,
            teachers=(),
        )


def _episodes(count: int) -> list[Episode]:
    lesson = Lesson(room=SOLUTION_ROOM, episodes=count)
    return [message for message in lesson.messages() if isinstance(message, Episode)]


def test_a_late_monitor_fills_the_curves_from_the_learner_page_by_page(tmp_path: Path) -> None:
    hub = MemoryHub(inline=True)
    learner = Learner(MemoryBus(hub), _episodes(250))
    monitor = Running(recorded(tmp_path), hub)
    monitor.publish(_episodes(251)[-1])
    learner.await_answers(3)
    monitor.stop()
    path = tmp_path / "lesson.rrd"
    assert [episode for _, episode, _ in series(path, "curves/steps")] == list(range(251))
    assert learner.asked[:3] == [0, 100, 200]


def test_an_episode_that_was_lost_on_the_way_is_asked_for(tmp_path: Path) -> None:
    hub = MemoryHub(inline=True)
    told = _episodes(6)
    Learner(MemoryBus(hub), told)
    monitor = Running(MonitorConfig(recording_dir=tmp_path, viewer=False), hub)
    monitor.publish(told[5])
    monitor.stop()
    assert [episode for _, episode, _ in series(tmp_path / "lesson.rrd", "curves/steps")] == list(range(6))


def test_without_a_learner_the_curves_begin_where_the_monitor_did(tmp_path: Path) -> None:
    monitor = Running(recorded(tmp_path))
    monitor.publish(*_episodes(6)[4:])
    monitor.stop()
    assert [episode for _, episode, _ in series(tmp_path / "lesson.rrd", "curves/steps")] == [4, 5]


def test_its_status_counts_the_sessions_that_go_on(tmp_path: Path) -> None:
    monitor = Running(recorded(tmp_path))
    monitor.publish(*Lesson(session="over", episodes=1).messages())
    monitor.publish(next(Lesson(session="on").messages()))
    monitor.work_off()
    status = monitor.status()
    monitor.stop()
    assert (status.sessions, status.running) == (2, 1)


def test_without_viewers_no_port_is_opened(tmp_path: Path) -> None:
    with _reserved() as (first, _), _reserved() as (second, _), _reserved() as (third, _):
        # All three ports are taken by this test: a monitor that opened one would fail.
        config = MonitorConfig(
            recording_dir=tmp_path, viewer=False, scene_port=first, curves_port=second, web_port=third
        )
        monitor = Running(config)
        monitor.stop()
    assert monitor.where == f"recordings: {tmp_path}"


@pytest.mark.parametrize("field", ["scene_port", "curves_port", "web_port"])
def test_a_taken_port_is_told_in_one_line_with_the_mend(field: str) -> None:
    with _reserved() as (port, _):
        ports: dict[str, Any] = {"scene_port": 0, "curves_port": 0, "web_port": 0, field: port}
        with pytest.raises(MonitorError) as refusal:
            Running(MonitorConfig(**ports))
    assert str(refusal.value) == (
        f"cannot serve viewers at 127.0.0.1:{port} ({field}): another program has the port, "
        "stop that one or choose another port, 0 for any free one"
    )


def test_the_port_that_viewers_take_for_themselves_is_refused() -> None:
    with pytest.raises(MonitorError, match="scene_port = 9876 is the port viewers take for themselves"):
        Running(MonitorConfig(scene_port=9876))


def test_a_folder_that_cannot_be_written_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(MonitorError, match=r"^cannot write recordings to .*; choose another recording_dir$"):
        Running(recorded(tmp_path / "file"))


def test_the_addresses_name_both_servers_for_the_native_viewer_and_the_page() -> None:
    addresses = Addresses(scene_port=1, curves_port=2, web_port=3)
    curves, scene = "rerun+http://127.0.0.1:2/proxy", "rerun+http://127.0.0.1:1/proxy"
    assert addresses.native_command.endswith(f"rerun --connect {curves} {scene}")
    escaped = "&".join(f"url={url.replace('+', '%2B')}" for url in (curves, scene))
    assert addresses.web_url == f"http://127.0.0.1:3/?{escaped}&hide_welcome_screen&theme=dark"


def test_the_command_for_the_viewer_can_be_run_as_it_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python = tmp_path / "my env" / "bin" / "python"
    python.parent.mkdir(parents=True)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert viewer_command(python, tmp_path) == "rerun", "there is none beside this Python"
    python.with_name("rerun").touch(0o755)
    assert viewer_command(python, python.parent.parent) == "bin/rerun"
    assert viewer_command(python, tmp_path) == "'my env/bin/rerun'"
    for elsewhere in (tmp_path / "elsewhere", python.parent):
        assert viewer_command(python, elsewhere) == f"'{python.with_name('rerun')}'"
    monkeypatch.setenv("PATH", str(python.parent))
    assert viewer_command(python, tmp_path) == "rerun"


def test_another_viewer_in_the_path_is_not_taken_for_the_one_of_this_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python, another = tmp_path / "env" / "bin" / "python", tmp_path / "system" / "rerun"
    for folder in (python.parent, another.parent):
        folder.mkdir(parents=True)
    another.touch(0o755)
    monkeypatch.setenv("PATH", str(another.parent))
    assert viewer_command(python, tmp_path) == "rerun", "better than none"
    python.with_name("rerun").mkdir()
    assert viewer_command(python, tmp_path) == "rerun", "a folder of this name is no program"
    python.with_name("rerun").rmdir()
    python.with_name("rerun").touch(0o755)
    assert viewer_command(python, tmp_path) == "env/bin/rerun"
    monkeypatch.setenv("PATH", f"{python.parent}:{another.parent}")
    assert viewer_command(python, tmp_path) == "rerun"
    another.unlink()
    another.symlink_to(python.with_name("rerun"))
    monkeypatch.setenv("PATH", str(another.parent))
    assert viewer_command(python, tmp_path) == "rerun", "a link to it is the same viewer"


def _with(message: Message, **changes: object) -> Message:
    fields: dict[str, Any] = {name: getattr(message, name) for name in message.__struct_fields__}
    return type(message)(**{**fields, **changes})


class _reserved:  # noqa: N801 - reads as a statement
    """A port of loopback that something listens at."""

    def __enter__(self) -> tuple[int, socket.socket]:
        self._socket = socket.socket()
        self._socket.bind(("127.0.0.1", 0))
        self._socket.listen()
        return self._socket.getsockname()[1], self._socket

    def __exit__(self, *_: object) -> None:
        self._socket.close()


def test_what_is_not_shown_in_time_after_a_stop_is_counted_as_dropped(tmp_path: Path) -> None:
    monitor = Running(recorded(tmp_path))
    messages = [message for _ in range(3) for message in Lesson(episodes=14).messages()]
    monitor.publish(*messages)
    counts = monitor.stop(worked_off=False)
    assert counts.messages + counts.dropped_messages == len(messages)
    assert monitor.left == []
