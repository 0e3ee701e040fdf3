"""Rows of a large shard read ahead of their proof: they count when it holds, and are forgotten otherwise."""

import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from services.runtime.journal import Row, Shard, read_rows, verify
from services.runtime.journal.amend import AMENDED_KIND, amendment_bodies
from services.runtime.journal.beside import BESIDE_BYTES, UnprovenRows, audit_beside
from services.runtime.journal.store import SQLITE_NAME

SESSION = "s"
PAD = BESIDE_BYTES // 8
PADS = 9
MARK = b"a body that stands once"
Events = list[tuple[str, int, bytes]]


def fill(shard: Shard) -> None:
    """Append so much that it is large, in three commits."""
    for number in range(PADS):
        shard.append(SESSION, "padding", bytes([number]) * PAD, at_ns=number)
        if number % 4 == 3:
            shard.commit()
    shard.append(SESSION, "answer", MARK, at_ns=PADS, unique=b"u" * 16, person="ann")
    shard.commit()


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("large")
    with Shard.open(data) as shard:
        fill(shard)
    return data


@pytest.fixture
def data(large: Path, tmp_path: Path) -> Path:
    return shutil.copytree(large, tmp_path / "data")


class Reader:
    """Reads ahead, and keeps what it saw."""

    def __init__(self, then: Callable[[], None] = lambda: None) -> None:
        self.seen: dict[str, Events] = {}
        self.calls = 0
        self._then = then

    def __call__(self, rows: UnprovenRows) -> None:
        self.calls += 1
        for name in rows.sessions():
            self.seen[name] = list(rows.events(name))
        self._then()


def children() -> set[int]:
    return {
        int(pid)
        for task in Path("/proc/self/task").iterdir()
        for pid in (task / "children").read_text().split()
    }


def test_rows_read_ahead_of_a_proof_that_holds_are_those_of_the_opened_shard(data: Path) -> None:
    reader = Reader()
    with Shard.open(data, 0, reader) as shard:
        assert shard.read_ahead == PADS + 1
        assert reader.seen == {SESSION: list(shard.events(SESSION))}
        assert list(shard.events(SESSION, shard.read_ahead)) == []
        assert shard.notes == ()
        shard.append(SESSION, "later", b"pending", at_ns=99)
        assert list(shard.events(SESSION, shard.read_ahead)) == [("later", 99, b"pending")]
    assert reader.calls == 1


def test_of_a_small_shard_nothing_is_read_ahead(tmp_path: Path) -> None:
    with Shard.open(tmp_path) as shard:
        shard.append(SESSION, "answer", MARK, at_ns=0)
    reader = Reader()
    with Shard.open(tmp_path, 0, reader) as shard:
        assert (reader.calls, shard.read_ahead) == (0, 0)
        assert list(shard.events(SESSION)) == [("answer", 0, MARK)]


def test_rows_of_a_damaged_file_were_not_read_ahead(data: Path) -> None:
    path = data / "shard-0" / SQLITE_NAME
    content = path.read_bytes()
    assert content.count(MARK) == 1
    path.write_bytes(content.replace(MARK, MARK.swapcase()))
    reader = Reader()
    with Shard.open(data, 0, reader) as shard:
        assert reader.seen[SESSION][-1] == ("answer", PADS, MARK.swapcase())
        assert shard.read_ahead == 0
        assert list(shard.events(SESSION))[-1] == ("answer", PADS, MARK)
        assert "a hash or the other file disagrees" in shard.notes[0]
    assert verify(data).problems == ()


def test_an_audit_that_finds_damage_says_that_nothing_was_rightly_read_ahead(data: Path) -> None:
    path = data / "shard-0" / SQLITE_NAME
    path.write_bytes(path.read_bytes().replace(MARK, MARK.swapcase()))
    reader = Reader()
    found, read_ahead = audit_beside(data / "shard-0", reader)
    assert (reader.calls, read_ahead, found.seq) == (1, 0, PADS)
    assert len(found.problems) == 1


@pytest.mark.parametrize("proven", [False, True], ids=["during the proof", "after the proof"])
def test_rows_that_an_older_owner_adds_meanwhile_are_read_as_they_stand_then(
    data: Path, *, proven: bool
) -> None:
    """Two lock files stand for a file system that gives the lock to both."""
    before = children()
    files = data / "shard-0"
    lock, of_the_old, of_the_new = (files / name for name in ("lock", "lock-of-the-old", "lock-of-the-new"))
    old = Shard.open(data)
    old.append(SESSION, "answer", b"from the old owner", at_ns=50, unique=b"o" * 16)
    lock.rename(of_the_old)

    def commit() -> None:
        if proven:
            (prover,) = children() - before
            os.waitid(os.P_PID, prover, os.WEXITED | os.WNOWAIT)
        lock.rename(of_the_new)
        of_the_old.rename(lock)
        old.commit()
        lock.rename(of_the_old)
        of_the_new.rename(lock)

    with Shard.open(data, 0, Reader(commit)) as shard:
        assert shard.read_ahead == 0
        assert list(shard.events(SESSION))[-1] == ("answer", 50, b"from the old owner")
        lock.rename(of_the_new)
        of_the_old.rename(lock)
        old.close()
        of_the_new.rename(lock)
    assert verify(data).problems == ()


def test_a_commit_that_only_the_mirror_holds_follows_what_was_read_ahead(data: Path, tmp_path: Path) -> None:
    image, files = tmp_path / "image", (SQLITE_NAME, f"{SQLITE_NAME}-wal")
    with Shard.open(data) as shard:
        for name in files:
            image.mkdir(exist_ok=True)
            shutil.copyfile(data / "shard-0" / name, image / name)
        shard.append(SESSION, "answer", b"late", at_ns=77, unique=b"v" * 16)
    for name in files:
        shutil.copyfile(image / name, data / "shard-0" / name)
    reader = Reader()
    with Shard.open(data, 0, reader) as shard:
        assert shard.read_ahead == PADS + 1
        assert list(shard.events(SESSION, shard.read_ahead)) == [("answer", 77, b"late")]
        assert [*reader.seen[SESSION], ("answer", 77, b"late")] == list(shard.events(SESSION))


def test_an_amendment_that_only_the_mirror_holds_changes_what_was_read_ahead(
    data: Path, tmp_path: Path
) -> None:
    with Shard.open(data) as shard:
        shard.erase({SESSION: {PADS + 1: b"said first"}}, at_ns=1)
    files = [data / "shard-0" / name for name in (SQLITE_NAME, f"{SQLITE_NAME}-wal")]
    with Shard.open(data) as shard:
        for path in files:
            shutil.copyfile(path, tmp_path / path.name)
        (body,) = amendment_bodies({PADS + 1: b"said anew"})
        shard.append(SESSION, AMENDED_KIND, body, at_ns=2)
    for path in files:
        shutil.copyfile(tmp_path / path.name, path)
    reader = Reader()
    with Shard.open(data, 0, reader) as shard:
        assert shard.read_ahead == 0
        assert reader.seen[SESSION][-1] == ("answer", PADS, b"said first")
        assert list(shard.events(SESSION))[-1] == ("answer", PADS, b"said anew")


def test_whatever_fails_on_unproven_rows_is_no_failure_of_the_journal(data: Path) -> None:
    def fail() -> None:
        message = "of what cannot be read"
        raise LookupError(message)

    with Shard.open(data, 0, Reader(fail)) as shard:
        assert shard.read_ahead == 0
        assert len(list(shard.events(SESSION))) == PADS + 1


def test_when_the_proving_process_dies_its_owner_proves_by_itself(data: Path) -> None:
    before = children()

    def kill() -> None:
        (prover,) = children() - before
        os.kill(prover, signal.SIGKILL)

    with Shard.open(data, 0, Reader(kill)) as shard:
        assert shard.read_ahead == 0
        assert list(shard.rows()) == list(read_rows(data))
    assert children() == before


def test_an_interrupted_opening_leaves_no_process_and_no_lock(data: Path) -> None:
    before = children()

    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Shard.open(data, 0, Reader(interrupt))
    assert children() == before
    with Shard.open(data) as shard:
        assert next(iter(shard.rows())) == Row(1, SESSION, "padding", 0, bytes(PAD), None, None)


def test_an_erased_row_is_read_ahead_as_it_is_amended(data: Path) -> None:
    with Shard.open(data) as shard:
        shard.erase({SESSION: {PADS + 1: b"what is read instead"}}, at_ns=1)
    reader = Reader()
    with Shard.open(data, 0, reader) as shard:
        assert shard.read_ahead == PADS + 2
        assert reader.seen[SESSION] == list(shard.events(SESSION))
        assert reader.seen[SESSION][-1] == ("answer", PADS, b"what is read instead")
