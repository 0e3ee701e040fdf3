"""Shards with known content."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from services.runtime.journal import Row, Shard

GROUPS = 12
ROWS_A_GROUP = 4


def expected_row(seq: int) -> Row:
    group = (seq - 1) // ROWS_A_GROUP
    is_answer = seq % 4 != 0
    return Row(
        seq=seq,
        session=f"s{seq % 3}",
        kind="answer" if is_answer else "close",
        at_ns=1_000 * group,
        body=f"body of row {seq} ".encode() * (1 + seq % 5),
        unique=seq.to_bytes(16, "big") if is_answer else None,
        person=f"person-{seq % 2}" if is_answer else None,
    )


def append(shard: Shard, row: Row) -> None:
    assert row.body is not None
    seq = shard.append(row.session, row.kind, row.body, at_ns=row.at_ns, unique=row.unique, person=row.person)
    assert seq == row.seq


@pytest.fixture
def rows() -> list[Row]:
    return [expected_row(seq) for seq in range(1, GROUPS * ROWS_A_GROUP + 1)]


@pytest.fixture
def put() -> Callable[[Shard, Row], None]:
    return append


@pytest.fixture
def closed_journal(tmp_path: Path, rows: list[Row]) -> Path:
    """A data directory as a clean stop leaves it: no WAL."""
    return _filled(tmp_path / "closed", rows)


@pytest.fixture
def crashed_journal(tmp_path: Path, rows: list[Row]) -> Path:
    """A data directory as a power cut leaves it: half of the rows are still only in the WAL."""
    live = tmp_path / "live"
    image = tmp_path / "crashed"
    _filled(live, rows[: len(rows) // 2])
    with Shard.open(live) as shard:
        for start in range(len(rows) // 2, len(rows), ROWS_A_GROUP):
            for row in rows[start : start + ROWS_A_GROUP]:
                append(shard, row)
            shard.commit()
        shutil.copytree(live, image, ignore=shutil.ignore_patterns("*-shm"))
    return image


def _filled(data_dir: Path, rows: list[Row]) -> Path:
    with Shard.open(data_dir) as shard:
        for start in range(0, len(rows), ROWS_A_GROUP):
            for row in rows[start : start + ROWS_A_GROUP]:
                append(shard, row)
            shard.commit()
    return data_dir
