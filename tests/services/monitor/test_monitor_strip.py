"""The strip of what teachers said: of the same moment as the board above it, in colours of its own."""

import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import rerun as rr
from rerun.chunk import RrdReader

from protocol.messages import Decision, SaidBy, Step
from services.monitor.config import Addresses, free_port
from services.monitor.curves import states_said
from services.monitor.live import Live
from services.monitor.rows import Indexed, Lane, Moment, Picture, Reliabilities, Rows
from services.monitor.scene import TEACHER_COLOURS
from services.monitor.session_view import SessionView
from services.monitor.writer import AGREED_COLOUR, DIFFERED_COLOUR, NamedActions, Writer, stream
from tests.services.monitor.feeder import Lesson
from tests.services.monitor.rrd_rows import rows_of
from tests.services.monitor.test_monitor_live import SavingViewer, eventually
from tests.services.monitor.test_monitor_palette import PALETTE, PIXELS, values_of, written

STATE = "StateChange:state"


def watched(view: SessionView, *messages: Decision | Step, from_s: float) -> list[Picture]:
    """Tell messages a second apart; return the pictures of the world that viewers are sent."""
    shown = []
    for number, message in enumerate(messages):
        now_s = from_s + number
        view.take(message, now_s)
        shown += [row for row in view.tick(now_s).live.scene if row.entity == "world"]
    return shown


def test_what_was_said_comes_with_the_picture_it_was_said_on_and_ends_with_the_next() -> None:
    messages = [each for each in Lesson(episodes=2).messages() if isinstance(each, Decision | Step)]
    at = next(number for number, each in enumerate(messages) if isinstance(each, Step) and len(each.said) > 1)
    view = SessionView(0.0)
    step, decision = messages[at], messages[at + 1]
    assert isinstance(step, Step)
    before, picture, after = watched(view, messages[at - 1], step, decision, from_s=100.0)
    moment = picture.moment
    assert before.lanes == ()
    assert picture.lanes == tuple(
        Lane(said.teacher, (moment,), (f"{said.action}{'' if said.action == step.action else '≠'}",))
        for said in step.said
    )
    assert moment.step == step.decision
    assert set(after.lanes) == {Lane(said.teacher, (after.moment,), ("",)) for said in step.said}
    assert after.moment.step == step.decision + 1


def test_a_word_ends_once_when_the_next_step_has_others_and_is_said_anew_when_it_has_it_again() -> None:
    step = next(each for each in Lesson(episodes=1).messages() if isinstance(each, Step))

    def said(number: int, *teachers: str) -> Step:
        words = tuple(SaidBy(teacher=name, kind="label", action=step.action) for name in teachers)
        told: Step = msgspec.structs.replace(
            step, decision=number, step=number, said=words, outcome="running"
        )
        return told

    spoken = [said(0, "ada"), said(1, "ben"), said(2, "ben"), said(3, "ada", "ben")]
    words = [
        {lane.teacher: lane.states for lane in picture.lanes}
        for picture in watched(SessionView(0.0), *spoken, from_s=10.0)
    ]
    word = (step.action,)
    assert words == [{"ada": word}, {"ada": ("",), "ben": word}, {"ben": word}, {"ada": word, "ben": word}]


def test_only_labels_are_words_about_the_step() -> None:
    said = (
        SaidBy(teacher="ada", kind="label", action="UP"),
        SaidBy(teacher="ben", kind="label", action="LEFT"),
        SaidBy(teacher="cyd", kind="mistake", action="UP"),
        SaidBy(teacher="dan", kind="reward", reward=1.0),
        SaidBy(teacher="eve", kind="abstain"),
    )
    assert states_said(said, "UP") == {"ada": "UP", "ben": "LEFT≠"}


def test_the_count_down_says_nothing_again() -> None:
    first = next(each for each in Lesson(episodes=1).messages() if isinstance(each, Decision) and each.view)
    opened: Decision = msgspec.structs.replace(first, phase="asking", remaining_ms=5000)
    view = SessionView(0.0)
    view.take(opened, 10.0)
    drawn = [
        picture
        for tenth in range(30)
        for picture in view.tick(10.0 + tenth / 10).live.scene
        if picture.entity == "world"
    ]
    assert len(drawn) > 10
    assert {picture.lanes for picture in drawn} == {()}


def test_both_streams_of_a_recording_know_all_words_of_a_lane(tmp_path: Path) -> None:
    named: NamedActions = {}
    for name, word in (("scene", "SOUTH"), ("curves", "PICKUP≠"), ("more", "")):
        path = tmp_path / f"{name}.rrd"
        path.write_bytes(b"")
        recording = stream("test", 0.1, send_properties=False)
        recording.set_sinks(rr.FileSink(path, write_footer=True))
        Writer(recording, named).write(Lane("ada", (Moment(4),), (word,)))
        recording.flush()
        recording.disconnect()
    (scene,), (curves,) = (
        configurations(tmp_path / f"{name}.rrd", "teachers/ada") for name in ("scene", "curves")
    )
    assert {"SOUTH", "UP≠"} <= scene.keys()
    assert curves.keys() == scene.keys() | {"PICKUP", "PICKUP≠"}
    assert configurations(tmp_path / "more.rrd", "teachers/ada") == [curves], "each stream is told of all"


def test_the_signs_of_a_lane_are_bounded_and_the_end_of_a_word_has_none(tmp_path: Path) -> None:
    states = ("", *(f"ACTION_{number}" for number in range(200)))
    lane = Lane("ada", tuple(Moment(step) for step in range(len(states))), states)
    path = written(tmp_path / "a.rrd", Picture("world", Moment(0), Indexed(PIXELS, PALETTE), (), (lane,)))
    (found,) = configurations(path, "teachers/ada")
    assert len(found) == 2 * 64
    assert not {"", "≠"} & found.keys()


def test_a_viewer_is_told_all_words_by_both_servers_whoever_speaks_last(tmp_path: Path) -> None:
    scene_port = free_port(set())
    addresses = Addresses(scene_port, free_port({scene_port}), web_port=None)
    live = Live(addresses)
    viewer = SavingViewer(tmp_path / "seen.rrd", addresses)
    word = Lane("ada", (Moment(2),), ("UP",))
    picture = Picture("world", Moment(2), Indexed(PIXELS, PALETTE), (), (word,))

    def told() -> list[set[str]]:
        with suppress(OSError, RuntimeError, ValueError), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the file is still being written
            return [set(states) for states in configurations(viewer.path, "teachers/ada")]
        return []

    try:
        live.show("words", Rows(curves=[Lane("ada", (Moment(1),), ("PICKUP",))]))
        live.show("words", Rows(scene=[picture]))
        eventually(lambda: len(told()) >= 2)
        assert all({"PICKUP", "PICKUP≠", "UP"} <= states for states in told())
    finally:
        viewer.end()
        live.close(5.0)


def test_the_legend_of_a_reliability_is_told_when_it_changes_and_only_then(tmp_path: Path) -> None:
    path = tmp_path / "a.rrd"
    path.write_bytes(b"")
    recording = stream("test", 0.1, send_properties=False)
    recording.set_sinks(rr.FileSink(path, write_footer=True))
    writer = Writer(recording)
    for number, label in enumerate(("ada (of two)", "ada (of two)", "ada")):
        writer.write(Reliabilities("ada", label, (1, 2, 3), (Moment(number),), (0.5,), (0.1,)))
    recording.flush()
    recording.disconnect()
    names = values_of(path, "reliability/ada", "Measurements:names", static=True)
    assert names == [["ada (of two)"], ["ada"]]


def test_a_teacher_without_a_lane_has_none_with_a_picture_either() -> None:
    everybody = [(f"t{number:02}", 1.0) for number in range(12)]
    view = SessionView(0.0)
    steps = [each for each in Lesson(episodes=1, teachers=everybody).messages() if isinstance(each, Step)]
    named = {lane.teacher for picture in watched(view, *steps, from_s=10.0) for lane in picture.lanes}
    assert 0 < len(named) <= 8


def test_words_are_written_in_the_stream_of_their_picture(tmp_path: Path) -> None:
    at = Moment(4, 7, 1)
    lanes = (Lane("ada", (at,), ("UP",)), Lane("ben", (at,), ("LEFT≠",)))
    path = written(tmp_path / "a.rrd", Picture("world", at, Indexed(PIXELS, PALETTE), (), lanes))
    times = {"step": 4, "wall": 7, "episode": 1}
    assert rows_of(path, "teachers/ada", STATE) == [(times, ["UP"])]
    assert rows_of(path, "teachers/ben", STATE) == [(times, ["LEFT≠"])]


def test_each_word_has_a_sign_and_the_colour_of_agreement_or_grey_and_never_a_teachers(
    tmp_path: Path,
) -> None:
    at = Moment(4)
    lanes = (Lane("ada", (at,), ("UP",)), Lane("ada", (Moment(5),), ("PICKUP≠",)))
    path = written(tmp_path / "a.rrd", Picture("world", at, Indexed(PIXELS, PALETTE), (), lanes))
    first, last = configurations(path, "teachers/ada")
    signs = {"LEFT": "←", "RIGHT": "→", "UP": "↑", "DOWN": "↓"}
    expected = {
        action + end: (sign, colour)
        for action, sign in signs.items()
        for end, colour in (("", AGREED_COLOUR), ("≠", DIFFERED_COLOUR))
    }
    assert first == expected
    assert last == expected | {
        "PICKUP": ("PICKUP", AGREED_COLOUR), "PICKUP≠": ("PICKUP", DIFFERED_COLOUR)
    }  # fmt: skip
    for colour in (AGREED_COLOUR, DIFFERED_COLOUR):
        near = [np.abs(np.subtract(colour, teacher)).max() for teacher in TEACHER_COLOURS]
        assert min(near) > 30


def configurations(path: Path, entity: str) -> list[dict[str, tuple[str, tuple[int, ...]]]]:
    """How a lane's states are written, each time that it was said."""
    found = []
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.entity_path != f"/{entity}" or "StateConfiguration:values" not in batch.schema.names:
            continue
        columns: list[list[Any]] = [
            batch.column(f"StateConfiguration:{name}").to_pylist() for name in ("values", "labels", "colors")
        ]
        for values, labels, colours in zip(*columns, strict=True):
            rgb = [tuple(colour.to_bytes(4, "big")[:3]) for colour in colours]
            found.append(dict(zip(values, zip(labels, rgb, strict=True), strict=True)))
    return found
