"""A session as tables, data set, levels and solutions, loaded back and compared with its journal."""

import csv
import json
import shlex
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from protocol.codec import decode
from protocol.journal import Folded, Record, fold, read_answer_body
from protocol.messages import Answer, WindowSpec
from services.exports.minari_data import write_minari
from services.exports.session_story import Story, read_story
from services.exports.session_tables import iso, session_tables
from services.exports.sokoban_files import lurd_solutions, xsb_levels
from services.exports.table import ExportError, Table
from services.exports.write import Format, write_tables
from services.runtime.journal import Row, read_rows
from sfid_core.sokoban.actions import ACTIONS, LETTERS
from sfid_core.sokoban.levels import packaged, parse_levels
from sfid_core.sokoban.rules import step
from sfid_core.teaching.personas import persona_named
from sfid_core.teaching.simulated import SimulatedTeacher
from tests.services.cli.command_line import sfid
from tests.services.learner.classroom import Classroom, Pupil, session

NAMES = ("session", "answers", "steps", "episodes", "states", "presence")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of two teachers: one late label, one replaced, abstentions, and then two whole episodes."""
    folder = tmp_path_factory.mktemp("lesson") / "data"
    room = Classroom(folder)
    room.create(session(window=WindowSpec(mode="early", span_ms=1_000), episodes=3, teachers_min=2))
    ann, bob = Pupil(room, "ann"), Pupil(room, "bob")
    ann.join()
    bob.join()
    first = room.decision
    ann.send(ann.message(first, action="LEFT", response_ms=250))
    ann.send(ann.message(first, action="UP", response_ms=400))
    room.pass_time(1_100)
    bob.send(bob.message(first, action="UP"))
    minds = {
        ann: SimulatedTeacher(1, "ann", "s1", persona_named("oracle", {})),
        bob: SimulatedTeacher(1, "bob", "s1", persona_named("oracle", {"silence": 0.5})),
    }
    room.pass_time(7)
    room.teach(minds, lambda: room.finished)
    bob.withdraw()
    room.pass_time(600)
    room.shard.close()
    return folder


@pytest.fixture(scope="module")
def story(data: Path) -> Story:
    return read_story(data, "s1")


def rows(data: Path, kind: str) -> list[Row]:
    return [row for row in read_rows(data, "s1") if row.kind == kind]


def folded(data: Path) -> Folded:
    told = fold(Record(row.kind, row.at_ns, row.body or b"") for row in read_rows(data, "s1"))
    assert told is not None
    return told


def by_name(tables: tuple[Table, ...]) -> dict[str, Table]:
    return {table.name: table for table in tables}


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def written(story: Story, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    write_tables(folder, "A lesson.", session_tables(story))
    return folder


def test_every_answer_of_the_journal_is_a_row_with_what_its_teacher_was_told(
    data: Path, written: Path
) -> None:
    told = [read_answer_body(row.body or b"") for row in rows(data, "answer")]
    messages = [decode(payload, Answer) for _, _, payload in told]
    table = read_csv(written / "answers.csv")
    assert [row["answer_id"] for row in table] == [message.answer_id.hex() for message in messages]
    assert [row["code"] for row in table] == [code.value for code, _, _ in told]
    assert [row["teacher"] for row in table] == [message.teacher for message in messages]
    assert [row["action"] for row in table] == [message.action or "" for message in messages]
    assert [int(row["seq"]) for row in table] == [row.seq for row in rows(data, "answer")]
    assert [row["at"] for row in table] == [iso(row.at_ns) for row in rows(data, "answer")]
    assert {"accepted", "late"} == {row["code"] for row in table}
    assert {"label", "abstain"} == {row["kind"] for row in table}


def test_what_was_applied_is_what_the_session_counts(story: Story, written: Path) -> None:
    table = read_csv(written / "answers.csv")
    first = [(row["teacher"], row["action"], row["code"], row["applied"]) for row in table[:3]]
    assert first == [
        ("ann", "LEFT", "accepted", "false"),
        ("ann", "UP", "accepted", "true"),
        ("bob", "UP", "late", "false"),
    ]
    assert sum(row["applied"] == "true" for row in table) == story.session.counts.applied
    assert not any(row["applied"] == "true" for row in table if row["kind"] == "abstain")


def test_response_times_are_the_teachers_in_ms_and_arrivals_the_learners(written: Path) -> None:
    table = read_csv(written / "answers.csv")
    assert [row["response_ms"] for row in table[:3]] == ["250.0", "400.0", ""]
    assert [row["latency_ms"] for row in table[:3]] == ["0.0", "0.0", ""]
    assert float(table[2]["at_s"]) - float(table[1]["at_s"]) == pytest.approx(1.1)


def test_steps_and_episodes_are_those_of_the_fold(data: Path, story: Story, written: Path) -> None:
    rebuilt = folded(data)
    steps, episodes = read_csv(written / "steps.csv"), read_csv(written / "episodes.csv")
    assert len(steps) == rebuilt.session.decision == len(rows(data, "step"))
    assert [int(row["decision"]) for row in steps] == list(range(len(steps)))
    assert [int(row["steps"]) for row in episodes] == [each.steps for each in rebuilt.session.episodes]
    for row, each in zip(episodes, rebuilt.session.episodes, strict=True):
        assert float(row["discounted_return"]) == each.discounted_return
        assert float(row["abs_td_error"]) == each.abs_td_error
        assert (row["outcome"], int(row["inputs"])) == (each.outcome.value, each.inputs)
    assert episodes[-1]["q_sha256"] == rebuilt.session.learner.sha256()
    assert [row["state"] for row in steps[1:]] == [
        row["next_state"] if row["outcome"] == "running" else following["state"]
        for row, following in pairwise(steps)
    ]
    last = steps[-1]
    values = rebuilt.session.learner.values(bytes.fromhex(last["state"]))
    assert tuple(float(last[f"q_{name}"]) for name in ("left", "right", "up", "down")) == values


def test_the_table_is_learnt_again_from_the_exported_steps_alone(written: Path) -> None:
    """Eq. 4 over the rows of steps.csv gives the exported Q: nothing that mattered was left out."""
    learnt: dict[str, list[float]] = {}
    names = ("LEFT", "RIGHT", "UP", "DOWN")
    for row in read_csv(written / "steps.csv"):
        values = learnt.setdefault(row["state"], [0.0] * 4)
        ahead = 0.0 if row["outcome"] in {"solved", "deadlock"} else max(learnt.get(row["next_state"], [0.0]))
        action = names.index(row["action"])
        delta = float(row["reward"]) + float(row["h"]) + 0.9 * ahead - values[action]
        values[action] += 0.1 * delta
        assert values == pytest.approx([float(row[f"q_{name.lower()}"]) for name in names])
        assert delta == pytest.approx(float(row["td_error_shaped"]))


def test_states_are_drawn_and_every_step_stands_in_one(written: Path) -> None:
    states = {row["state"]: row["view"] for row in read_csv(written / "states.csv")}
    assert {row["state"] for row in read_csv(written / "steps.csv")} <= set(states)
    assert all(set(view) <= set("# .$*@+\n") for view in states.values())


def test_coming_and_going_is_told(written: Path) -> None:
    assert [(row["teacher"], row["event"]) for row in read_csv(written / "presence.csv")] == [
        ("ann", "joined"), ("bob", "joined"), ("bob", "left"),
    ]  # fmt: skip


def test_the_session_is_one_row_whose_counts_add_up(written: Path) -> None:
    (row,) = read_csv(written / "session.csv")
    assert (row["session"], row["method"], row["actions"]) == ("s1", "sfid", "LEFT RIGHT UP DOWN")
    parts = ("applied", "superseded", "late", "rejected", "pending")
    assert int(row["submitted"]) == sum(int(row[part]) for part in parts)
    assert int(row["late"]) == 1


def test_parquet_holds_the_very_cells_of_csv(story: Story, written: Path) -> None:
    for table in session_tables(story):
        read = pyarrow.parquet.read_table(written / f"{table.name}.parquet")
        assert read.column_names == [column.name for column in table.columns]
        for column in table.columns:
            assert read[column.name].to_pylist() == table.listed(column), (table.name, column.name)


def test_the_codebook_explains_every_column_of_every_table(story: Story, written: Path) -> None:
    book = json.loads((written / "codebook.json").read_text(encoding="utf-8"))
    tables = session_tables(story)
    assert tuple(table["name"] for table in book["tables"]) == NAMES == tuple(t.name for t in tables)
    for explained in book["tables"]:
        with (written / f"{explained['name']}.csv").open(encoding="utf-8") as file:
            assert file.readline().strip().split(",") == [column["name"] for column in explained["columns"]]
        assert all(column["description"].endswith((".", ")")) for column in explained["columns"])
    units = {column["name"]: column["unit"] for column in book["tables"][1]["columns"]}
    assert (units["response_ms"], units["latency_ms"], units["at_s"]) == ("ms", "ms", "s")


def test_times_are_iso_in_utc() -> None:
    at_ns = 1_700_000_000_123_456_789
    assert iso(at_ns) == "2023-11-14T22:13:20.123456Z"
    assert datetime.fromisoformat(iso(at_ns)).astimezone(UTC).timestamp() == pytest.approx(
        at_ns / 1e9, abs=1e-6
    )


def test_levels_are_read_back_as_the_starts_of_the_episodes(story: Story) -> None:
    read = parse_levels(xsb_levels(story))
    starts = {row.measures.view for row in story.steps if row.measures.step == 0}
    level = packaged("room")[0].to_xsb()
    assert {one.to_xsb() for one in read} == starts | {level}
    assert len(read) == len(starts | {level})
    assert read[0].title == "room 0"


def test_solutions_are_walked_again_to_the_boards_that_they_ended_on(story: Story) -> None:
    blocks = lurd_solutions(story).strip().split("\n\n")
    assert len(blocks) == 3
    for block, (number, steps) in zip(blocks, story.by_episode().items(), strict=True):
        board = parse_levels(block)[0].start
        key, _, moves = block.splitlines()[-1].partition(": ")
        for letter in moves:
            board = step(board, ACTIONS[LETTERS.index(letter.lower())]).board
        assert board.to_xsb() == steps[-1].measures.next_view
        solved = story.episodes[number].measures.outcome.value == "solved"
        assert (key == "Solution") is solved is board.solved


def test_a_minari_data_set_is_loaded_back_step_for_step(
    story: Story, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    minari = pytest.importorskip("minari")
    folder = write_minari(story, tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    loaded = minari.load_dataset("sfid/s1-v0")
    assert loaded.total_episodes == 3
    assert loaded.total_steps == folded(data).session.decision
    assert (loaded.action_space.n, loaded.observation_space.shape) == (4, (7, 7))
    for episode, steps in zip(loaded, story.by_episode().values(), strict=True):
        measures = [row.measures for row in steps]
        assert len(episode.observations) == len(steps) + 1
        assert {len(each) for each in episode.infos.values()} == {len(steps) + 1}
        assert list(episode.actions) == [one.action for one in measures]
        assert list(episode.rewards) == [one.reward for one in measures]
        assert list(episode.terminations) == [one.outcome.terminal for one in measures]
        assert list(episode.truncations) == [one.outcome.value == "cap" for one in measures]
        assert list(episode.infos["label"][1:]) == [
            -1 if one.label is None else one.label for one in measures
        ]
        assert list(episode.infos["h"][1:]) == [one.learned.h for one in measures]
        assert [bytes(row) for row in episode.infos["state"][:-1]] == [one.state for one in measures]
        assert np.array_equal(episode.infos["q"][1:], [one.values for one in measures])
        assert all(loaded.observation_space.contains(each) for each in episode.observations)
    answers = pyarrow.parquet.read_table(folder / "tables" / "answers.parquet")
    assert answers["answer_id"].to_pylist() == [row.message.answer_id.hex() for row in story.answers]
    with pytest.raises(ExportError, match="holds a data set already"):
        write_minari(story, tmp_path)


@pytest.mark.real
@pytest.mark.parametrize("form", ["lurd", "xsb"])
def test_the_command_that_an_export_of_levels_ends_with_reads_it(
    data: Path, tmp_path: Path, form: str
) -> None:
    out = tmp_path / f"my {form}"
    said = sfid("export", str(data), "--format", form, "--out", str(out)).stdout
    command = shlex.split(said.partition("`")[2].partition("`")[0])
    assert command == ["sfid", "levels", "show", str(out)]
    shown = sfid(*command[1:])
    assert (shown.code, "#####" in shown.stdout) == (0, True)


@pytest.mark.parametrize("form", ["csv", "parquet", "lurd", "xsb", "minari", "rrd"])
def test_the_command_writes_each_format_and_tells_what_it_wrote(
    form: str, data: Path, tmp_path: Path
) -> None:
    done = sfid("export", str(data), "--format", form, "--out", str(tmp_path / "out"), "--json")
    assert done.code == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    assert (told["session"], told["format"], told["episodes"]) == ("s1", form, 3)
    assert told["out"] == str(tmp_path / "out")
    assert (tmp_path / "out").exists()


@pytest.mark.real
def test_the_command_says_in_one_line_what_cannot_be_written(data: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    unwritable = sfid("export", str(data), "--format", "csv", "--out", str(tmp_path / "file" / "x"))
    assert (unwritable.code, unwritable.stdout) == (2, "")
    assert "give a directory you may write to" in unwritable.stderr.splitlines()[-1]
    nobody = sfid("export", str(data), "--format", "csv", "--session", "s2", "--out", str(tmp_path / "x"))
    assert (nobody.code, nobody.stdout) == (2, "")
    assert nobody.stderr.splitlines()[-1].endswith("choose one with --session: s1")


def test_formats_are_named_alike_on_the_command_line_and_in_files() -> None:
    assert {form.value for form in Format} == {"csv", "parquet"}
