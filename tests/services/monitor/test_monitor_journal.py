"""Recordings against the journal: made live, by a monitor that was restarted, and again from the journal."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from rerun.chunk import RrdReader

from protocol.codec import decode, encode
from protocol.journal import Record
from protocol.messages import Decision, Episode, JournalRows, RowsQuery, SaidBy, Step, WindowSpec
from protocol.retelling import Retelling
from services.monitor.chronicle import Chronicle
from services.monitor.past import Past
from services.monitor.recordings import Recording, check_folder
from services.monitor.replayed import messages_of, record_again
from services.monitor.rows import Rows
from services.monitor.scene import TeacherColours, draw_world, frames_of_step, read_view
from services.monitor.service import MonitorConfig
from services.monitor.session_view import SessionView
from services.monitor.worker import Worker
from services.runtime.bus import Received, Reply
from services.runtime.memory_bus import MemoryBus
from sfid_core.sokoban.actions import ACTIONS
from tests.services.cli.command_line import sfid
from tests.services.learner.classroom import KEYS, Classroom, Pupil, optimal, session
from tests.services.monitor.rrd_rows import entities_of, rows_of
from tests.services.monitor.test_monitor_pictures import indexes_of
from tests.services.monitor.test_monitor_service import PIXELS, SCALARS, Running

NAMES = tuple(action.name for action in ACTIONS)
EARLY = WindowSpec(mode="early", span_ms=1_000)


@pytest.fixture
def room(tmp_path: Path) -> Classroom:
    return Classroom(tmp_path / "data")


def taught(room: Classroom, steps: int) -> None:
    """Two teachers, one of whom errs every third time; a pause, a restart and a late answer on the way."""
    room.create(session(window=EARLY, episodes=3))
    pupils = [Pupil(room, name) for name in ("ann", "bob")]
    for pupil in pupils:
        pupil.join()
    for number in range(steps):
        if room.decision.phase != "asking":
            break
        if number == 5:
            room.pass_time(600)  # what is not committed would happen anew
            room.kill_learner()
            room.start_learner()
            room.pass_time(100)
        decision = room.decision
        best = optimal(decision.view)[0]
        room.pass_time(90 + 40 * (number % 3))
        for index, pupil in enumerate(pupils):
            if number % 7 == 6 and index == 0:
                continue
            wrong = index == 1 and number % 3 == 0
            pupil.label(decision, NAMES[(best + wrong) % 4])
        room.pass_time(1_000)


def content_of(path: Path) -> dict[tuple[str, str], list[tuple[dict[str, Any], Any]]]:
    """Every row of every column of a recording, by entity and component, in its order."""
    found: dict[tuple[str, str], list[tuple[dict[str, Any], Any]]] = {}
    for entity in sorted(entities_of(path)):
        components = {
            name
            for chunk in RrdReader(path).stream().to_chunks()
            if chunk.entity_path == f"/{entity}"
            for name in chunk.to_record_batch().schema.names
            if ":" in name
        }
        for component in sorted(components):
            found[entity, component] = rows_of(path, entity, component)
    return found


def watched_live(room: Classroom, folder: Path, steps: int) -> Path:
    """What a monitor writes that was there from the beginning."""
    monitor = Running(MonitorConfig(recording_dir=folder, viewer=False), room.hub)
    taught(room, steps)
    room.settle()
    monitor.stop()
    return folder / "s1.rrd"


def test_the_journal_told_again_is_what_the_learner_published(room: Classroom) -> None:
    heard: list[Decision | Step | Episode] = []
    room.watcher.subscribe(KEYS.decision(), lambda message: heard.append(decode(message.payload, Decision)))
    room.watcher.subscribe(
        KEYS.measures(),
        lambda message: heard.append(decode(message.payload, Step | Episode)),  # type: ignore[arg-type]
    )
    taught(room, 60)
    retelling = Retelling()
    told = [
        message
        for row in room.rows()
        if row.body is not None
        for _, message in retelling.tell(Record(row.kind, row.at_ns, row.body))
    ]
    assert len(room.episodes) >= 1
    assert told == heard


def test_a_recording_made_again_from_the_journal_is_the_live_one_row_by_row(
    room: Classroom, tmp_path: Path
) -> None:
    live = watched_live(room, tmp_path / "live", 60)
    room.shard.close()
    written = record_again(room.data_dir, "s1", "local", tmp_path / "again.rrd")
    assert (written.steps, written.episodes) == (len(room.steps), len(room.episodes))
    expected, found = content_of(live), content_of(written.path)
    assert found.keys() == expected.keys()
    assert {key for key in found if found[key] != expected[key]} == set()
    assert {"world", "policy", "reliability/ann", "teachers/bob", "events", "now"} <= {
        entity for entity, _ in found
    }


def test_a_monitor_that_is_restarted_fills_everything_again_from_the_journal(
    room: Classroom, tmp_path: Path
) -> None:
    live = watched_live(room, tmp_path / "live", 60)
    turns = iter(range(12))

    def stopping() -> bool:
        room.settle()
        return next(turns, None) is None

    config = MonitorConfig(recording_dir=tmp_path / "late", viewer=False, session="s1")
    check_folder(tmp_path / "late")
    late = Worker(config, MemoryBus(room.hub), None, room.clock)
    late.subscribe()
    late.run(stopping)
    assert content_of(tmp_path / "late" / "s1.rrd") == content_of(live)


def test_every_curve_and_picture_holds_what_the_journal_tells(room: Classroom, tmp_path: Path) -> None:
    path = watched_live(room, tmp_path / "live", 60)
    room.shard.close()
    told = list(messages_of(room.data_dir, "s1"))
    episodes = [message for message in told if isinstance(message, Episode)]
    steps = [message for message in told if isinstance(message, Step)]
    values: dict[str, Callable[[Episode], list[float]]] = {
        "curves/td_error": lambda e: [e.abs_td_error, e.abs_td_error_shaped],
        "curves/return": lambda e: [e.discounted_return, e.discounted_env_return],
        "curves/inputs": lambda e: [float(e.inputs)],
    }
    for entity, row in values.items():
        expected = [(e.decision, e.episode, e.at_ns, row(e)) for e in episodes]
        found = [(at["step"], at["episode"], at["wall"], v) for at, v in rows_of(path, entity, SCALARS)]
        assert found == expected, entity
    colours, frames = TeacherColours(), {}
    for step in steps:
        for said in step.said:
            colours.of(said.teacher)
        for frame in frames_of_step(step, step.at_ns):
            frames[frame.moment.step, frame.action] = indexes_of(draw_world(frame, colours)).tobytes()
    pictures = [
        (at["step"], bytes(pixels)) for at, (pixels,) in rows_of(path, "world", PIXELS) if "wall" in at
    ]
    assert {pixels for _, pixels in pictures} <= set(frames.values())
    assert pictures[0][0] == 0
    for step in steps:
        read_view(step.view)
    agreed: list[bool] = []
    expected_share = {}
    for step in steps:
        labels = [said.action == step.action for said in step.said if said.kind == "label"]
        agreed = (agreed + labels)[-50:]
        if labels:
            expected_share[step.decision] = [sum(agreed) / len(agreed)]
    shares = {at["step"]: value for at, value in rows_of(path, "curves/agreement", SCALARS)}
    assert shares == {number: expected_share[number] for number in shares}
    assert len(shares) > len(steps) // 2
    lanes = {
        (teacher, at["step"]): state
        for teacher in ("ann", "bob")
        for at, (state,) in rows_of(path, f"teachers/{teacher}", "StateChange:state")
    }
    labels_given = {
        (each.teacher, step.decision): f"{each.action}{'' if each.action == step.action else '≠'}"
        for step in steps
        for each in step.said
    }
    assert {key: state for key, state in lanes.items() if state} == labels_given


def test_the_journal_is_handed_out_page_by_page_without_gap_or_repeat(room: Classroom) -> None:
    taught(room, 200)
    rows, after, pages, whole = [], 0, 0, False
    while not whole:
        reply = room.ask(room.watcher, KEYS.learner("rows"), RowsQuery(session="s1", after_seq=after))
        assert len(reply.payload) <= 65_536
        page = decode(reply.payload, JournalRows)
        rows += [(row.seq, row.kind, row.at_ns, row.body) for row in page.rows]
        after, whole, pages = page.after_seq, page.whole, pages + 1
    assert rows == [(row.seq, row.kind, row.at_ns, row.body) for row in room.rows()]
    assert room.refused(KEYS.learner("rows"), RowsQuery(session="nobody")).code == "unknown-session"


def test_export_writes_a_recording_and_says_what_is_in_it(room: Classroom, tmp_path: Path) -> None:
    taught(room, 30)
    room.shard.close()
    out = tmp_path / "s1.rrd"
    done = sfid("export", str(room.data_dir), "--out", str(out), "--json")
    assert done.code == 0, done.stderr
    assert json.loads(done.stdout) == {
        "session": "s1", "format": "rrd", "out": str(out),
        "steps": len(room.steps), "episodes": len(room.episodes),
    }  # fmt: skip
    assert len(rows_of(out, "curves/steps", SCALARS)) == len(room.episodes)
    missing = sfid("export", str(room.data_dir), "--out", str(out), "--session", "other")
    assert (missing.code, missing.stderr.count("\n")) == (2, 1)
    assert "no session other: choose one with --session: s1" in missing.stderr


def test_ten_thousand_steps_a_second_are_thinned_by_the_sessions_own_time(tmp_path: Path) -> None:
    said = (
        SaidBy(teacher="ann", kind="label", action="UP"),
        SaidBy(teacher="bob", kind="label", action="UP"),
    )
    view = "#######\n#     #\n#@$ . #\n#     #\n#######"
    chronicle = Chronicle()
    start_ns = 1_790_000_000 * 10**9
    for number in range(10_000):
        chronicle.tell(_step(number, start_ns + number * 100_000, view, said))
    rows = chronicle.take()
    assert len(rows.scene) <= 20 + 2 + 2
    points = {type(row).__name__: 0 for row in rows.curves}
    for row in rows.curves:
        points[type(row).__name__] += len(getattr(row, "moments", (1,)))
    assert points["Curves"] <= 10
    assert points["Lane"] <= 2 * 2 * 50
    assert points["Reliabilities"] <= 2 * 1
    sizes = {}
    for name, written in (("fast", rows), ("layout", Rows())):
        recording = Recording(tmp_path / f"{name}.rrd", name, f"local-{name}")
        recording.write(written)
        assert recording.close()
        sizes[name] = (tmp_path / f"{name}.rrd").stat().st_size
    assert sizes["fast"] - sizes["layout"] < 140_000


def _step(number: int, at_ns: int, view: str, said: tuple[SaidBy, ...]) -> Step:
    return Step(
        session="fast", epoch=1, decision=number, episode=0, step=number, at_ns=at_ns,
        state=number.to_bytes(16, "big"), view=view, action="UP", said=said, label="UP", h=1.0, reward=0.0,
        td_error=0.0, td_error_shaped=0.0, outcome="running", next_view=view, values=(0.0,) * 4,
    )  # fmt: skip


def test_an_answer_that_is_no_page_ends_the_past_and_watching_goes_on() -> None:
    view = SessionView(0.0, past=True)
    asked: list[bytes] = []
    past = Past("s1", view, asked.append)
    past.begin()
    assert decode(asked[0], RowsQuery).after_seq == 0
    step = _step(0, 1_790_000_000 * 10**9, "#####\n#@$.#\n#####", ())
    view.take(msgspec.structs.replace(step, session="s1"), 1.0)
    assert view.chronicle.take().scene == []
    past.take(Reply(ok=False, payload=encode(step)))
    assert past.is_done()
    assert [row.entity for row in view.chronicle.take().scene] == ["world", "policy"]


def test_whoever_watches_costs_the_learner_one_publish_a_step_and_one_an_episode(room: Classroom) -> None:
    heard: list[Received] = []
    room.watcher.subscribe(f"{KEYS.root}/session/**", heard.append)
    taught(room, 60)
    told = [message for message in heard if message.key != KEYS.decision("s1")]
    assert {message.key for message in told} == {KEYS.measures("s1")}
    read: list[Step | Episode] = [decode(message.payload, Step | Episode) for message in told]  # type: ignore[arg-type]
    steps = [message.decision for message in read if isinstance(message, Step)]
    episodes = [message.episode for message in read if isinstance(message, Episode)]
    assert steps == list(range(len(steps)))
    assert len(steps) >= 60
    assert episodes == list(range(len(episodes)))
    assert episodes
