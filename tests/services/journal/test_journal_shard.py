"""What a shard promises its learner while nothing goes wrong."""

from __future__ import annotations

import stat
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from services.runtime.journal import (
    JournalDuplicate,
    JournalError,
    Row,
    Shard,
    Verification,
    read_rows,
    verify,
)
from services.runtime.journal.shard import PENDING_BYTES_MAX
from services.runtime.journal.shards import note_count

Put = Callable[[Shard, Row], None]


def test_what_was_committed_is_read_back_by_the_writer_a_reader_and_the_next_writer(
    closed_journal: Path, rows: list[Row]
) -> None:
    assert list(read_rows(closed_journal)) == rows
    assert list(read_rows(closed_journal, "s1")) == [row for row in rows if row.session == "s1"]
    with Shard.open(closed_journal) as shard:
        assert shard.notes == ()
        assert list(shard.rows()) == rows
        assert list(shard.rows("s2", after_seq=20)) == [r for r in rows if r.session == "s2" and r.seq > 20]
        assert shard.sessions() == ("s1", "s2", "s0")  # in the order of their first rows


def test_pending_rows_are_seen_by_their_writer_alone_until_the_commit(
    tmp_path: Path, rows: list[Row], put: Put
) -> None:
    with Shard.open(tmp_path) as shard:
        for row in rows[:3]:
            put(shard, row)
        assert shard.syncs == 0
        assert list(shard.rows()) == rows[:3]
        assert shard.sessions() == ("s1", "s2", "s0")  # in the order of their first rows
        assert shard.find("s1", rows[0].unique or b"") == rows[0]
        assert list(read_rows(tmp_path)) == []
        shard.commit()
        assert shard.syncs == 2
        assert list(read_rows(tmp_path)) == rows[:3]
        shard.commit()
        assert shard.syncs == 2


def test_an_id_is_found_in_its_session_alone_for_ever(closed_journal: Path, rows: list[Row]) -> None:
    with Shard.open(closed_journal) as shard:
        for row in rows:
            if row.unique is not None:
                assert shard.find(row.session, row.unique) == row
                assert shard.find("another", row.unique) is None


def test_a_second_row_with_the_same_id_is_refused_and_leaves_the_group_whole(
    closed_journal: Path, rows: list[Row]
) -> None:
    unique = rows[0].unique or b""
    fresh = bytes(range(16))
    with Shard.open(closed_journal) as shard:
        with pytest.raises(JournalDuplicate, match="already in the journal"):
            shard.append("s1", "answer", b"again", at_ns=1, unique=unique)
        first = shard.append("s1", "answer", b"new", at_ns=1, unique=fresh)
        with pytest.raises(JournalDuplicate):
            shard.append("s1", "answer", b"again", at_ns=1, unique=fresh)
        assert shard.find("s2", unique) is None
        second = shard.append("s2", "answer", b"same id, other session", at_ns=1, unique=unique)
        shard.commit()
        assert (first, second) == (len(rows) + 1, len(rows) + 2)
    assert verify(closed_journal).ok


def test_discarded_rows_leave_no_trace_and_their_numbers_are_used_again(
    tmp_path: Path, rows: list[Row], put: Put
) -> None:
    with Shard.open(tmp_path) as shard:
        put(shard, rows[0])
        shard.commit()
        shard.append("gone", "answer", b"gone", at_ns=1, unique=bytes(16))
        shard.discard_pending()
        assert shard.find("gone", bytes(16)) is None
        put(shard, rows[1])
    assert list(read_rows(tmp_path)) == rows[:2]
    assert verify(tmp_path).ok


def test_verification_counts_sessions_labels_and_rows_of_all_shards(
    closed_journal: Path, rows: list[Row]
) -> None:
    note_count(closed_journal, 11)
    with Shard.open(closed_journal, 10) as shard:
        shard.append("t", "answer", b"", at_ns=-5)
    labels = sum(row.kind == "answer" for row in rows) + 1
    expected = Verification(ok=True, sessions=4, labels=labels, rows=len(rows) + 1, problems=())
    assert verify(closed_journal) == expected
    assert [row.session for row in read_rows(closed_journal)][-1] == "t"


def test_a_living_writer_does_not_disturb_verification_or_readers(
    tmp_path: Path, rows: list[Row], put: Put
) -> None:
    with Shard.open(tmp_path) as shard:
        for count, row in enumerate(rows, start=1):
            put(shard, row)
            shard.commit()
            assert list(read_rows(tmp_path)) == rows[:count]
            found = verify(tmp_path)
            assert (found.ok, found.rows, found.problems, found.notes) == (True, count, (), ())


def test_every_field_survives_at_its_limits(tmp_path: Path) -> None:
    cases = [
        ("", "", b"", -(2**63), None, None),
        ("s\0s", "kind", bytes(range(256)), 2**63 - 1, bytes(16), ""),
        ("ß" * 32767, "\U0001f600", b"x" * 100_000, 0, b"\xff" * 16, "p" * 65534),
    ]
    with Shard.open(tmp_path) as shard:
        for session, kind, body, at_ns, unique, person in cases:
            shard.append(session, kind, body, at_ns=at_ns, unique=unique, person=person)
        shard.commit()
    expected = [
        Row(seq, session, kind, at_ns, body, unique, person)
        for seq, (session, kind, body, at_ns, unique, person) in enumerate(cases, start=1)
    ]
    assert list(read_rows(tmp_path)) == expected
    assert verify(tmp_path).problems == ()


@pytest.mark.parametrize(
    "change",
    [
        {"at_ns": 2**63},
        {"session": "s" * 65536},
        {"session": "\ud800"},
        {"person": "p" * 65535},
        {"unique": b"short"},
        {"body": bytes(16 * 2**20 + 1)},
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_becomes_pending(
    tmp_path: Path, change: dict[str, object]
) -> None:
    fields = {"session": "s", "kind": "k", "body": b"", "at_ns": 0, "unique": None, "person": None, **change}
    with Shard.open(tmp_path) as shard:
        with pytest.raises(ValueError, match=r"\S"):
            shard.append(**fields)  # type: ignore[arg-type]
        assert list(shard.rows()) == []
        assert shard.append("s", "k", b"", at_ns=0) == 1
    assert verify(tmp_path).rows == 1


def test_events_behind_a_row_leave_out_what_is_pending_before_it(tmp_path: Path) -> None:
    with Shard.open(tmp_path) as shard:
        for number in range(1, 5):
            assert shard.append("s", "k", str(number).encode(), at_ns=number) == number
            if number == 2:
                shard.commit()
        told = {after: [at_ns for _, at_ns, _ in shard.events("s", after)] for after in range(5)}
        assert told == {0: [1, 2, 3, 4], 1: [2, 3, 4], 2: [3, 4], 3: [4], 4: []}


def test_pending_bytes_are_bounded(tmp_path: Path) -> None:
    body = bytes(8 * 2**20)
    with Shard.open(tmp_path) as shard:
        for _ in range(PENDING_BYTES_MAX // len(body)):
            shard.append("s", "k", body, at_ns=0)
        with pytest.raises(JournalError, match="commit before appending"):
            shard.append("s", "k", b"", at_ns=0)
        shard.commit()
        shard.append("s", "k", b"", at_ns=0)
    assert verify(tmp_path).rows == PENDING_BYTES_MAX // len(body) + 1


def test_files_are_private_to_their_owner(tmp_path: Path) -> None:
    data_dir = tmp_path / "new" / "data"
    with Shard.open(data_dir) as shard:
        shard.append("s", "k", b"", at_ns=0)
        shard.commit()
        modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in (data_dir / "shard-0").iterdir()}
    assert stat.S_IMODE(data_dir.stat().st_mode) == 0o700
    assert stat.S_IMODE((data_dir / "shard-0").stat().st_mode) == 0o700
    assert set(modes.values()) == {0o600}
    assert set(modes) >= {"journal.sqlite", "journal.mirror", "lock", "epoch"}


def test_a_clean_stop_leaves_no_write_ahead_log_and_closing_twice_is_safe(tmp_path: Path) -> None:
    shard = Shard.open(tmp_path)
    shard.append("s", "k", b"", at_ns=0)
    shard.close()
    shard.close()
    assert sorted(path.name for path in (tmp_path / "shard-0").iterdir()) == [
        "epoch",
        "journal.mirror",
        "journal.sqlite",
        "lock",
    ]
    with pytest.raises(JournalError, match="closed"):
        shard.append("s", "k", b"", at_ns=0)


def test_a_writer_has_one_thread_of_its_own_which_ends_with_it(tmp_path: Path) -> None:
    before = set(threading.enumerate())
    with Shard.open(tmp_path) as shard:
        shard.append("s", "k", b"", at_ns=0)
        shard.commit()
        assert [thread.name for thread in set(threading.enumerate()) - before] == ["journal-sync"]
    assert set(threading.enumerate()) == before


def test_a_directory_without_a_journal_is_a_problem_not_an_empty_success(tmp_path: Path) -> None:
    found = verify(tmp_path)
    assert (found.ok, len(found.problems)) == (False, 1)
    assert "no journal" in found.problems[0]
    with pytest.raises(JournalError, match="no journal"):
        list(read_rows(tmp_path))


def test_a_path_below_a_regular_file_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(JournalError) as caught:
        Shard.open(tmp_path / "file" / "data")
    assert "\n" not in str(caught.value)
    assert str(tmp_path / "file") in str(caught.value)
