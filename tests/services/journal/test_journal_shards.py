"""Several shards in one data directory: one that is gone is missed by whoever reads or writes the others."""

import shutil
from pathlib import Path

import pytest

from services.learner.ownership import agree_on_shards
from services.runtime.journal import JournalError, Shard, read_rows, shard_directories, verify


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Three shards, with a session each."""
    data = tmp_path / "data"
    agree_on_shards(data, 3)
    for number in range(3):
        with Shard.open(data, number) as shard:
            shard.append(f"s{number}", "created", b"x", at_ns=1)
    return data


def test_every_shard_is_there_from_the_first_agreement_on(tmp_path: Path) -> None:
    agree_on_shards(tmp_path, 3)
    assert [path.name for path in shard_directories(tmp_path)] == ["shard-0", "shard-1", "shard-2"]
    assert verify(tmp_path).problems == ()
    assert (tmp_path / "shards").read_text() == "3 begun\n"


def test_an_agreement_that_was_cut_short_is_made_whole(tmp_path: Path) -> None:
    (tmp_path / "shards").write_text("3\n")
    Shard.open(tmp_path, 0).close()
    agree_on_shards(tmp_path, 3)
    assert len(shard_directories(tmp_path)) == 3


def test_a_shard_that_is_gone_is_a_loss_to_everybody(data: Path) -> None:
    assert verify(data).problems == ()
    shutil.rmtree(data / "shard-1")
    told = f"{data}/shard-1: this shard is gone: mount its disk, or restore it from a backup"
    assert verify(data).problems == (told,)
    for use in (shard_directories, lambda path: list(read_rows(path)), lambda path: agree_on_shards(path, 3)):
        with pytest.raises(JournalError, match="this shard is gone"):
            use(data)
    assert not (data / "shard-1").exists(), "nobody makes an empty one in its place"


def test_an_empty_directory_in_the_place_of_a_shard_is_a_loss_too(data: Path) -> None:
    shutil.rmtree(data / "shard-1")
    (data / "shard-1").mkdir()
    assert not verify(data).ok
    with pytest.raises(JournalError):
        agree_on_shards(data, 3)


@pytest.mark.parametrize("shards", [1, 3])
def test_without_the_note_nobody_guesses_how_many_shards_there_are(data: Path, shards: int) -> None:
    (data / "shards").unlink()
    with pytest.raises(JournalError, match="write into it how many shards there are, 3 or more"):
        agree_on_shards(data, shards)
    assert not verify(data).ok


@pytest.mark.parametrize("note", ["", "many", "0", "-1", "2000", "3.5"])
def test_a_note_that_is_no_number_is_refused(data: Path, note: str) -> None:
    (data / "shards").write_text(note)
    with pytest.raises(JournalError, match="not a number of shards"):
        agree_on_shards(data, 3)


def test_a_session_in_two_shards_is_a_problem(data: Path) -> None:
    with Shard.open(data, 2) as shard:
        shard.append("s0", "created", b"y", at_ns=2)
    assert verify(data).problems == (f"{data}/shard-2: session s0 is in another shard too",)
