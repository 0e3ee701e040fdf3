"""One writer a shard: the lock while it lives, the epoch after."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from services.runtime.journal import JournalFenced, JournalLocked, Shard, read_rows, verify
from services.runtime.journal.store import Store

WRITER = Path(__file__).parent / "journal_writer.py"


def test_a_second_process_is_refused_in_one_line_that_names_the_owner_and_the_next_one_may_enter(
    tmp_path: Path,
) -> None:
    command = [sys.executable, str(WRITER), str(tmp_path), "1", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == "open 1\n"
        with pytest.raises(JournalLocked) as caught:
            Shard.open(tmp_path)
        owner.kill()
        owner.wait(timeout=10)
    assert f"process {owner.pid} " in str(caught.value)
    assert str(tmp_path / "shard-0") in str(caught.value)
    assert "\n" not in str(caught.value)
    with Shard.open(tmp_path) as shard:
        assert shard.epoch == 2


def test_verification_and_reading_never_keep_a_writer_out(tmp_path: Path) -> None:
    with Shard.open(tmp_path):
        reader = read_rows(tmp_path)
        assert next(reader, None) is None
    for _ in range(20):
        assert verify(tmp_path).ok
        Shard.open(tmp_path).close()


def test_every_owner_has_a_higher_epoch_even_after_a_file_was_lost(tmp_path: Path) -> None:
    epochs = []
    for lost in (None, "journal.sqlite", "epoch", "journal.mirror", None):
        if lost is not None:
            (tmp_path / "shard-0" / lost).unlink()
        with Shard.open(tmp_path) as shard:
            shard.append("s", "k", b"", at_ns=0)
            epochs.append(shard.epoch)
    assert epochs == [1, 2, 3, 4, 5]
    assert verify(tmp_path).problems == ()


def test_an_old_writer_whose_lock_file_was_stolen_cannot_commit(tmp_path: Path) -> None:
    old = Shard.open(tmp_path)
    old.append("s", "answer", b"in time", at_ns=0)
    old.commit()
    old.append("s", "answer", b"too late", at_ns=1)
    (tmp_path / "shard-0" / "lock").unlink()
    with Shard.open(tmp_path) as new:
        with pytest.raises(JournalFenced, match="stop"):
            old.commit()
        new.append("s", "answer", b"the new owner's", at_ns=2)
        new.commit()
        with pytest.raises(JournalFenced):
            old.close()
    assert [row.body for row in read_rows(tmp_path)] == [b"in time", b"the new owner's"]
    assert verify(tmp_path).problems == ()


def test_a_writer_fenced_by_the_epoch_alone_leaves_what_the_new_owner_wrote(tmp_path: Path) -> None:
    """Two lock files stand for a file system that gives the lock to both."""
    files = tmp_path / "shard-0"
    old = Shard.open(tmp_path)
    old.append("s", "answer", b"in time", at_ns=0)
    old.commit()
    (files / "lock").rename(files / "lock-of-the-old")
    new = Shard.open(tmp_path)
    new.append("s", "answer", b"the new owner's", at_ns=1)
    new.commit()
    mirror = (files / "journal.mirror").read_bytes()
    (files / "lock").rename(files / "lock-of-the-new")
    (files / "lock-of-the-old").rename(files / "lock")
    old.append("s", "answer", b"too late", at_ns=2)
    with pytest.raises(JournalFenced, match="newer learner"):
        old.commit()
    assert (files / "journal.mirror").read_bytes() == mirror
    old.discard_pending()
    old.close()
    (files / "lock-of-the-new").rename(files / "lock")
    new.append("s", "answer", b"and on", at_ns=3)
    new.close()
    assert [row.body for row in read_rows(tmp_path)] == [b"in time", b"the new owner's", b"and on"]
    assert (verify(tmp_path).problems, verify(tmp_path).notes) == ((), ())


def test_the_epoch_alone_fences_a_writer_that_still_holds_its_lock(tmp_path: Path) -> None:
    old = Shard.open(tmp_path)
    old.append("s", "answer", b"in time", at_ns=0)
    old.commit()
    mirror = (tmp_path / "shard-0" / "journal.mirror").read_bytes()
    taker = Store(tmp_path / "shard-0")
    assert taker.take_over(0).epoch == 2
    taker.close()
    old.append("s", "answer", b"too late", at_ns=1)
    for _ in range(2):
        with pytest.raises(JournalFenced, match="newer learner"):
            old.commit()
    assert (tmp_path / "shard-0" / "journal.mirror").read_bytes() == mirror
    old.discard_pending()
    old.close()
    assert [row.body for row in read_rows(tmp_path)] == [b"in time"]
    assert verify(tmp_path).problems == ()
