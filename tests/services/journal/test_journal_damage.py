"""Damaged, cut and missing files: repaired from the other file, or refused; never quietly fewer rows."""

from __future__ import annotations

import random
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from protocol.framing import frames
from services.runtime.journal import JournalDamaged, JournalError, JournalNewer, Row, Shard, read_rows, verify

FLIPS_A_FILE = 120
SQLITE_HEADER_BITS = 800


def reopened(data_dir: Path) -> list[Row]:
    with Shard.open(data_dir) as shard:
        found = list(shard.rows())
        assert all(shard.find(row.session, row.unique) == row for row in found if row.unique is not None)
    return found


def last_frame(mirror: Path) -> tuple[int, int]:
    with mirror.open("rb") as log:
        *_, last = frames(log)
    return last.start, last.end


def one_more_commit(data_dir: Path) -> Row:
    with Shard.open(data_dir) as shard:
        seq = shard.append("s9", "answer", b"last", at_ns=9, unique=b"9" * 16)
    return Row(seq, "s9", "answer", 9, b"last", b"9" * 16, None)


def copied(data_dir: Path, to: Path) -> Path:
    if to.exists():
        shutil.rmtree(to)
    shutil.copytree(data_dir, to)
    return to / "shard-0"


def flipped_bits(path: Path, rng: random.Random) -> Iterator[int]:
    bits = path.stat().st_size * 8
    yield from (rng.randrange(bits) for _ in range(FLIPS_A_FILE))
    yield from (rng.randrange(min(bits, SQLITE_HEADER_BITS)) for _ in range(FLIPS_A_FILE // 4))


@pytest.mark.parametrize("name", ["journal.sqlite", "journal.sqlite-wal", "journal.mirror"])
def test_after_any_bit_flip_verify_says_so_or_every_row_is_still_there_and_opening_loses_none(
    crashed_journal: Path, tmp_path: Path, rows: list[Row], name: str
) -> None:
    assert verify(crashed_journal).problems == ()
    for bit in flipped_bits(crashed_journal / "shard-0" / name, random.Random(name)):
        shard = copied(crashed_journal, tmp_path / "flipped")
        content = bytearray((shard / name).read_bytes())
        content[bit // 8] ^= 1 << (bit % 8)
        (shard / name).write_bytes(content)
        found = verify(shard.parent)
        assert found.ok == (found.problems == ())
        if found.ok:
            # The rule: a flip verify accepts changed nothing that anybody can read.
            assert (found.rows, list(read_rows(shard.parent))) == (len(rows), rows), bit
        try:
            assert reopened(shard.parent) == rows, bit
        except JournalNewer:
            # A flip in the version number cannot be told from a newer version; refusing keeps every byte.
            assert not found.ok
        else:
            assert verify(shard.parent).problems == (), bit


def test_a_flip_in_a_row_is_named_with_its_number(closed_journal: Path) -> None:
    path = closed_journal / "shard-0" / "journal.sqlite"
    content = path.read_bytes()
    path.write_bytes(content.replace(b"body of row 7 ", b"body of row 8 ", 1))
    found = verify(closed_journal)
    assert not found.ok
    assert "row 7 " in found.problems[0]


def test_a_mirror_cut_at_any_byte_of_its_last_frame_is_completed_from_sqlite_to_the_same_bytes(
    closed_journal: Path, tmp_path: Path, rows: list[Row]
) -> None:
    last = one_more_commit(closed_journal)
    start, end = last_frame(closed_journal / "shard-0" / "journal.mirror")
    whole = (closed_journal / "shard-0" / "journal.mirror").read_bytes()
    shard = copied(closed_journal, tmp_path / "cut")
    for cut in range(start, end):
        (shard / "journal.mirror").write_bytes(whole[:cut])
        found = verify(shard.parent)
        assert (found.problems, found.rows) == ((), len(rows) + 1)
        assert "1 rows are in SQLite alone" in found.notes[0]
        assert len(found.notes) == 1 + (cut > start)
        assert list(read_rows(shard.parent)) == [*rows, last]
        assert reopened(shard.parent) == [*rows, last]
        assert (shard / "journal.mirror").read_bytes() == whole
        assert verify(shard.parent).notes == ()
    assert list(shard.glob("*.damaged-*")) == []


def test_a_mirror_that_lacks_more_than_the_last_commit_is_damage_and_is_rebuilt(
    closed_journal: Path, rows: list[Row]
) -> None:
    last = one_more_commit(closed_journal)
    mirror = closed_journal / "shard-0" / "journal.mirror"
    with mirror.open("rb") as log:
        before_last = list(frames(log))[-2]
    whole = mirror.read_bytes()
    for cut in (before_last.start, before_last.end - 1):
        mirror.write_bytes(whole[:cut])
        found = verify(closed_journal)
        assert found.problems == (f"{mirror}: ends at row 44, SQLite at row 49",)
        assert reopened(closed_journal) == [*rows, last]
        assert verify(closed_journal).notes == ()


def test_a_mirror_cut_below_its_last_frame_with_bytes_behind_is_damage(
    closed_journal: Path, rows: list[Row]
) -> None:
    last = one_more_commit(closed_journal)
    mirror = closed_journal / "shard-0" / "journal.mirror"
    with mirror.open("rb") as log:
        *_, before_last, last_frame_of_log = frames(log)
    content = mirror.read_bytes()
    mirror.write_bytes(
        content[: before_last.end] + b"?" + content[last_frame_of_log.start :],
    )
    assert "before its end" in verify(closed_journal).problems[0]
    assert reopened(closed_journal) == [*rows, last]
    assert verify(closed_journal).notes == ()


def test_after_a_power_cut_the_last_commit_is_whole_when_either_file_kept_it_and_gone_when_neither_did(
    crashed_journal: Path, tmp_path: Path, rows: list[Row]
) -> None:
    """The two are synced at the same time, so a power cut may leave any part of each."""
    live = crashed_journal.parent / "two-commits"
    shutil.copytree(crashed_journal, live)
    with Shard.open(live) as writer:
        writer.append("s9", "answer", b"before", at_ns=8)
        writer.commit()
        before = copied(live, tmp_path / "before")
        writer.append("s9", "answer", b"last", at_ns=9, unique=b"9" * 16)
        writer.commit()
        after = copied(live, tmp_path / "after")
    (after / "journal.sqlite-shm").unlink()
    rng = random.Random(5)
    kept = {}
    for name in ("journal.mirror", "journal.sqlite-wal"):
        old, new = (before / name).stat().st_size, (after / name).stat().st_size
        assert old < new
        kept[name] = [old, new, *(rng.randrange(old, new) for _ in range(8))]
    whole = {name: (after / name).read_bytes() for name in kept}
    for cut in kept["journal.mirror"]:
        for wal_cut in kept["journal.sqlite-wal"]:
            image = copied(after.parent, tmp_path / "image")
            for name, size in (("journal.mirror", cut), ("journal.sqlite-wal", wal_cut)):
                (image / name).write_bytes(whole[name][:size])
            is_kept = cut == len(whole["journal.mirror"]) or wal_cut == len(whole["journal.sqlite-wal"])
            found = verify(image.parent)
            assert (found.problems, found.rows) == ((), len(rows) + 1 + is_kept)
            bodies = [row.body for row in reopened(image.parent)[len(rows) :]]
            assert bodies == [b"before", b"last"][: 1 + is_kept], (cut, wal_cut)
            assert (verify(image.parent).problems, verify(image.parent).notes) == ((), ())


def test_a_living_writer_whose_mirror_is_one_commit_late_is_sound_and_two_late_is_not(
    tmp_path: Path, rows: list[Row], put: Callable[[Shard, Row], None]
) -> None:
    mirror = tmp_path / "shard-0" / "journal.mirror"
    with Shard.open(tmp_path) as shard:
        for row in rows[:3]:
            put(shard, row)
            shard.commit()
        whole = mirror.read_bytes()
        with mirror.open("rb") as log:
            ends = [one.end for one in frames(log)]
        mirror.write_bytes(whole[: ends[-2]])
        late = verify(tmp_path)
        mirror.write_bytes(whole[: ends[-3]])
        later = verify(tmp_path)
        mirror.write_bytes(whole)
    assert (late.problems, late.rows, late.notes) == ((), 3, ())
    assert later.problems == (f"{mirror}: ends at row 1, SQLite at row 3",)
    assert verify(tmp_path).problems == ()


def test_a_last_commit_whose_rows_are_in_neither_file_is_refused_though_the_mirror_ends_before_it(
    closed_journal: Path,
) -> None:
    one_more_commit(closed_journal)
    shard = closed_journal / "shard-0"
    start, _ = last_frame(shard / "journal.mirror")
    (shard / "journal.mirror").write_bytes((shard / "journal.mirror").read_bytes()[:start])
    with closing(sqlite3.connect(shard / "journal.sqlite", isolation_level=None)) as db:
        db.execute("DELETE FROM rows WHERE seq = 49")
    assert not verify(closed_journal).ok
    with pytest.raises(JournalDamaged, match="row 49 of 49") as caught:
        Shard.open(closed_journal)
    assert caught.value.missing == 1


def test_an_unfinished_commit_cut_at_any_byte_of_the_mirror_is_dropped_whole_or_completed_whole(
    closed_journal: Path, tmp_path: Path, rows: list[Row]
) -> None:
    before = copied(closed_journal, tmp_path / "before")
    last = one_more_commit(closed_journal)
    start, end = last_frame(closed_journal / "shard-0" / "journal.mirror")
    whole = (closed_journal / "shard-0" / "journal.mirror").read_bytes()
    for cut in range(start, end + 1):
        shard = copied(before.parent, tmp_path / "cut")
        (shard / "journal.mirror").write_bytes(whole[:cut])
        expected = [*rows, last] if cut == end else rows
        found = verify(shard.parent)
        assert (found.problems, found.rows, len(found.notes)) == ((), len(expected), int(cut > start))
        assert list(read_rows(shard.parent)) == expected
        assert reopened(shard.parent) == expected
        assert verify(shard.parent).notes == ()


@pytest.mark.parametrize("name", ["journal.sqlite", "journal.mirror"])
@pytest.mark.parametrize("damage", ["missing", "empty", "zeroed block", "noise"])
def test_either_file_alone_brings_the_other_back(
    closed_journal: Path, rows: list[Row], name: str, damage: str
) -> None:
    path = closed_journal / "shard-0" / name
    content = path.read_bytes()
    if damage == "missing":
        path.unlink()
    elif damage == "empty":
        path.write_bytes(b"")
    elif damage == "noise":
        path.write_bytes(random.Random(1).randbytes(len(content)))
    else:
        path.write_bytes(content[:1024] + bytes(4096) + content[1024 + 4096 :])
    assert not verify(closed_journal).ok
    with Shard.open(closed_journal) as shard:
        assert list(shard.rows()) == rows
        assert any(name in note for note in shard.notes)
        assert shard.append("s0", "close", b"on it goes", at_ns=1) == len(rows) + 1
    assert verify(closed_journal).problems == ()
    assert list(read_rows(closed_journal))[:-1] == rows


def test_a_lost_write_ahead_log_is_made_good_from_the_mirror(crashed_journal: Path, rows: list[Row]) -> None:
    (crashed_journal / "shard-0" / "journal.sqlite-wal").unlink()
    assert list(read_rows(crashed_journal)) == rows
    assert reopened(crashed_journal) == rows
    assert verify(crashed_journal).problems == ()


def test_a_stale_copy_of_either_file_is_brought_up_to_date(
    closed_journal: Path, tmp_path: Path, rows: list[Row]
) -> None:
    for name in ("journal.sqlite", "journal.mirror"):
        stale = copied(closed_journal, tmp_path / "stale")
        current = copied(closed_journal, tmp_path / "current")
        with Shard.open(current.parent) as shard:
            shard.append("s9", "answer", b"newer", at_ns=9)
        shutil.copy(stale / name, current / name)
        found = reopened(current.parent)
        assert found[:-1] == rows
        assert found[-1].body == b"newer"
        assert verify(current.parent).problems == ()


def test_damage_in_both_files_at_different_rows_loses_nothing(closed_journal: Path, rows: list[Row]) -> None:
    shard = closed_journal / "shard-0"
    for name, row in (("journal.sqlite", 5), ("journal.mirror", 40)):
        content = (shard / name).read_bytes()
        text = f"body of row {row} ".encode()
        assert text in content
        (shard / name).write_bytes(content.replace(text, text.upper(), 1))
    assert not verify(closed_journal).ok
    assert reopened(closed_journal) == rows
    assert verify(closed_journal).problems == ()


def test_a_row_damaged_in_both_files_is_refused_with_the_count_and_nothing_is_touched(
    closed_journal: Path,
) -> None:
    shard = closed_journal / "shard-0"
    for name in ("journal.sqlite", "journal.mirror"):
        content = (shard / name).read_bytes()
        (shard / name).write_bytes(content.replace(b"body of row 17 ", b"BODY of row 17 "))
    before = {path.name: path.read_bytes() for path in shard.glob("journal.*")}
    with pytest.raises(JournalDamaged, match="row 17 of 48") as caught:
        Shard.open(closed_journal)
    assert caught.value.missing >= 1
    assert "\n" not in str(caught.value)
    assert {path.name: path.read_bytes() for path in shard.glob("journal.*")} == before


def test_both_files_missing_from_a_used_shard_is_refused(closed_journal: Path) -> None:
    for name in ("journal.sqlite", "journal.mirror"):
        (closed_journal / "shard-0" / name).unlink()
    with pytest.raises(JournalDamaged, match="backup"):
        Shard.open(closed_journal)


def test_files_of_two_shards_are_not_joined(closed_journal: Path, tmp_path: Path, rows: list[Row]) -> None:
    other = tmp_path / "other"
    with Shard.open(other) as shard:
        shard.append("x", "answer", b"another deployment", at_ns=1)
    shutil.copy(other / "shard-0" / "journal.mirror", closed_journal / "shard-0" / "journal.mirror")
    assert not verify(closed_journal).ok
    assert reopened(closed_journal) == rows


def test_a_newer_schema_is_refused_by_every_door_and_left_alone(closed_journal: Path) -> None:
    path = closed_journal / "shard-0" / "journal.sqlite"
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("PRAGMA user_version = 3")
    before = path.read_bytes()
    with pytest.raises(JournalNewer, match="upgrade"):
        Shard.open(closed_journal)
    with pytest.raises(JournalNewer):
        list(read_rows(closed_journal))
    found = verify(closed_journal)
    assert not found.ok
    assert "newer version" in found.problems[0]
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "statement",
    [
        "DELETE FROM rows WHERE seq = 48",
        "DELETE FROM rows WHERE seq = 20",
        "UPDATE rows SET body = NULL WHERE seq = 9",
        "UPDATE rows SET session = 's7' WHERE seq = 9",
        "UPDATE rows SET answer_id = zeroblob(16) WHERE seq = 9",
        "UPDATE rows SET at_ns = at_ns + 1 WHERE seq = 9",
        "UPDATE rows SET person = 'another' WHERE seq = 9",
        "UPDATE head SET seq = 47",
        "UPDATE head SET chain = zeroblob(32)",
        "UPDATE head SET shard_id = zeroblob(16)",
        "UPDATE head SET seq_before = 49",
        "UPDATE head SET seq_before = -1",
        "DELETE FROM head",
        "DROP INDEX rows_answer",
        "CREATE TABLE more (x) STRICT",
    ],
)
def test_every_change_behind_the_writers_back_is_found_and_undone(
    closed_journal: Path, rows: list[Row], statement: str
) -> None:
    sql = statement.replace("more (x)", "more (x INTEGER)")
    with closing(sqlite3.connect(closed_journal / "shard-0" / "journal.sqlite", isolation_level=None)) as db:
        db.execute(sql)
    assert not verify(closed_journal).ok
    assert reopened(closed_journal) == rows
    assert verify(closed_journal).problems == ()


@pytest.mark.parametrize("occurrence", [0, 1])
def test_an_id_changed_in_the_table_or_only_in_the_index_is_found_and_undone(
    closed_journal: Path, rows: list[Row], occurrence: int
) -> None:
    path = closed_journal / "shard-0" / "journal.sqlite"
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    parts = path.read_bytes().split((46).to_bytes(16, "big"))
    assert len(parts) == 3
    ids = [(46).to_bytes(16, "big"), (46).to_bytes(16, "big")]
    ids[occurrence] = b"\x01" + ids[occurrence][1:]
    path.write_bytes(parts[0] + ids[0] + parts[1] + ids[1] + parts[2])
    assert not verify(closed_journal).ok
    assert reopened(closed_journal) == rows
    assert verify(closed_journal).problems == ()


def test_an_erased_body_leaves_a_chain_that_still_holds(closed_journal: Path, rows: list[Row]) -> None:
    path = closed_journal / "shard-0" / "journal.sqlite"
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("UPDATE rows SET body = NULL, salt = NULL, person = NULL WHERE person = 'person-1'")
    (closed_journal / "shard-0" / "journal.mirror").unlink()
    expected = [row._replace(body=None, person=None) if row.person == "person-1" else row for row in rows]
    assert reopened(closed_journal) == expected
    assert verify(closed_journal).problems == ()
    assert b"person-1" not in (closed_journal / "shard-0" / "journal.mirror").read_bytes()


@pytest.mark.parametrize("first", ["journal.sqlite", "journal.mirror"])
def test_an_erasure_that_reached_one_file_is_completed_not_undone(
    closed_journal: Path, tmp_path: Path, rows: list[Row], first: str
) -> None:
    erased = copied(closed_journal, tmp_path / "erased")
    with closing(sqlite3.connect(erased / "journal.sqlite", isolation_level=None)) as db:
        db.execute("UPDATE rows SET body = NULL, salt = NULL, person = NULL WHERE seq = 9")
    (erased / "journal.mirror").unlink()
    Shard.open(erased.parent).close()
    shutil.copy(erased / first, closed_journal / "shard-0" / first)
    assert not verify(closed_journal).ok
    assert reopened(closed_journal) == [
        row._replace(body=None, person=None) if row.seq == 9 else row for row in rows
    ]
    assert verify(closed_journal).problems == ()


def test_an_erased_row_cannot_be_given_another_body(closed_journal: Path) -> None:
    path = closed_journal / "shard-0" / "journal.sqlite"
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("UPDATE rows SET body = x'01', salt = zeroblob(16) WHERE seq = 9")
    (closed_journal / "shard-0" / "journal.mirror").unlink()
    with pytest.raises(JournalError, match="row 9 of 48"):
        Shard.open(closed_journal)


def test_names_in_the_schema_that_are_no_text_any_more_are_found_and_undone(
    closed_journal: Path, tmp_path: Path, rows: list[Row]
) -> None:
    """SQLite quotes a damaged name in its message, which the sqlite3 module then fails to decode."""
    content = (closed_journal / "shard-0" / "journal.sqlite").read_bytes()
    begin, end = content.index(b"CREATE"), content.rindex(b"STRICT", 0, 4096)
    for at in range(begin, end, 7):
        shard = copied(closed_journal, tmp_path / "flipped")
        damaged = bytearray(content)
        damaged[at] ^= 0x80
        (shard / "journal.sqlite").write_bytes(damaged)
        assert not verify(shard.parent).ok
        assert reopened(shard.parent) == rows
        assert verify(shard.parent).problems == ()
