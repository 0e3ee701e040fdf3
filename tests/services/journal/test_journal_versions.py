"""Journals of every earlier version are read as they lie, and brought to this one by the first writer."""

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from services.replay import replay_directory
from services.runtime.journal import JournalError, Shard, read_rows, verify
from services.runtime.journal.store import SCHEMA, SCHEMA_VERSION
from tests.golden.make_journals import JOURNALS, downgraded
from tests.services.cli.command_line import sfid
from tests.services.learner.classroom import Classroom

VERSIONS = sorted(path.name for path in JOURNALS.iterdir())
OLDER = [name for name in VERSIONS if name != f"version-{SCHEMA_VERSION}"]


@pytest.fixture(params=VERSIONS)
def version(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def copied(version: str, to: Path) -> tuple[Path, dict[str, Any]]:
    shutil.copytree(JOURNALS / version, to)
    return to, json.loads((to / "expected.json").read_text())


def marked(data: Path) -> tuple[int, str]:
    """Return the version in the file, and how its head was created."""
    with closing(sqlite3.connect(data / "shard-0" / "journal.sqlite")) as db:
        (number,) = db.execute("PRAGMA user_version").fetchone()
        (sql,) = db.execute("SELECT sql FROM sqlite_schema WHERE name = 'head'").fetchone()
    return number, sql


def content(data: Path) -> list[tuple[int, str, bytes | None, str | None]]:
    return [(row.seq, row.kind, row.body, row.person) for row in read_rows(data)]


def test_there_is_a_stored_journal_of_this_version_and_of_one_before() -> None:
    assert f"version-{SCHEMA_VERSION}" in VERSIONS
    assert OLDER


def test_every_version_is_verified_and_replayed_without_being_changed(version: str, tmp_path: Path) -> None:
    data, expected = copied(version, tmp_path / "data")
    before = {path: path.read_bytes() for path in (data / "shard-0").iterdir()}
    proof = verify(data)
    assert (proof.ok, proof.problems, proof.rows, proof.labels) == (
        True, (), expected["rows"], expected["labels"],
    )  # fmt: skip
    (replayed,) = replay_directory(data)
    assert (replayed.matches, replayed.q_sha256) == (True, expected["q_sha256"])
    assert {path: path.read_bytes() for path in before} == before


@pytest.mark.parametrize("older", OLDER)
def test_the_first_writer_brings_an_older_journal_to_this_version_with_every_row(
    older: str, tmp_path: Path
) -> None:
    data, expected = copied(older, tmp_path / "data")
    before = content(data)
    with Shard.open(data) as shard:
        assert any("written by an older version" in note for note in shard.notes)
        shard.append("s9", "answer", b"after", at_ns=1)
    assert marked(data) == (SCHEMA_VERSION, SCHEMA["head"])
    assert content(data)[:-1] == before
    assert (verify(data).ok, verify(data).rows) == (True, expected["rows"] + 1)
    with Shard.open(data) as shard:
        assert shard.notes == ()
    assert sorted(path.name for path in (data / "shard-0").glob("*.damaged-*")) == []


@pytest.mark.parametrize("older", OLDER)
def test_a_learner_takes_a_session_up_from_an_older_journal(older: str, tmp_path: Path) -> None:
    data, expected = copied(older, tmp_path / "data")
    room = Classroom(data)
    assert room.learner.sessions["s1"].session.learner.sha256() == expected["q_sha256"]
    room.shard.close()
    assert replay_directory(data)[0].matches


@pytest.mark.parametrize("older", OLDER)
def test_a_backup_of_an_older_journal_is_one(older: str, tmp_path: Path) -> None:
    data, expected = copied(older, tmp_path / "data")
    done = sfid("backup", str(data), str(tmp_path / "copy"), "--json")
    assert (done.code, json.loads(done.stdout)["rows"]) == (0, expected["rows"])


def test_damage_of_an_older_journal_is_mended_from_its_mirror(tmp_path: Path) -> None:
    data, expected = copied("version-1", tmp_path / "data")
    path = data / "shard-0" / "journal.sqlite"
    spoilt = bytearray(path.read_bytes())
    spoilt[-3000] ^= 1
    path.write_bytes(spoilt)
    with Shard.open(data):
        pass
    assert (verify(data).ok, verify(data).rows) == (True, expected["rows"])


def test_a_commit_that_only_the_older_mirror_holds_is_completed(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with Shard.open(data) as shard:
        shard.append("s1", "answer", b"one", at_ns=1)
        shard.commit()
        shard._store.checkpoint()  # noqa: SLF001 - what a crash leaves: SQLite without the last commit
        behind = (data / "shard-0" / "journal.sqlite").read_bytes()
        shard.append("s1", "answer", b"two", at_ns=2)
    (data / "shard-0" / "journal.sqlite").write_bytes(behind)
    downgraded(data / "shard-0" / "journal.sqlite")
    with Shard.open(data) as shard:
        assert [row.body for row in shard.rows()] == [b"one", b"two"]
    assert verify(data).ok


@pytest.mark.parametrize("command", [("verify",), ("replay",), ("forget", "--person", "ann")])
def test_a_newer_journal_is_refused_in_one_line_by_every_command(
    command: tuple[str, ...], tmp_path: Path
) -> None:
    data, _ = copied(f"version-{SCHEMA_VERSION}", tmp_path / "data")
    with closing(sqlite3.connect(data / "shard-0" / "journal.sqlite", isolation_level=None)) as db:
        db.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    done = sfid(command[0], str(data), *command[1:])
    assert done.code in {1, 2}
    assert "newer version" in done.stdout + done.stderr
    assert done.stderr.count("\n") <= 1
    with pytest.raises(JournalError, match="upgrade sfid"):
        Shard.open(data)
