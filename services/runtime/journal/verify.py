"""The journal read without owning it: all its rows, and the proof that nothing in it was lost or changed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from services.runtime.journal.amend import AMENDED_KIND, amended, read_amendments
from services.runtime.journal.audit import Audit, audit
from services.runtime.journal.chain import Record, Row, decode_group
from services.runtime.journal.erasing import is_interrupted
from services.runtime.journal.errors import JournalError, translated
from services.runtime.journal.lock import is_owned, read_epoch
from services.runtime.journal.mirror import MirrorReader
from services.runtime.journal.shards import shard_directories
from services.runtime.journal.store import (
    SQLITE_NAME,
    open_read_only,
    read_amended_rows,
    read_head,
    read_records,
)


@dataclass(frozen=True, slots=True)
class Verification:
    """What `verify` found over all shards.

    Attributes:
        ok: True when every row is proven.
        sessions: how many sessions have rows.
        labels: how many rows are answers.
        rows: how many rows were proven.
        problems: one line each; empty when `ok`.
        erased: how many answers were erased, or replaced without somebody who is; `labels` counts them.
        notes: what is not damage but worth knowing, such as a commit the next open will complete.
    """

    ok: bool
    sessions: int
    labels: int
    rows: int
    problems: tuple[str, ...]
    notes: tuple[str, ...] = ()
    erased: int = 0


def verify(data_dir: Path) -> Verification:
    """Prove every row of every shard, also while a writer lives; changes nothing and never raises for damage.

    Checked: schema version, tables and indexes, that seq is dense, every seal and the whole chain, that the
    head is its end, that both files hold the same rows byte for byte, that unique ids are unique; that no
    shard is gone, and no session is in two.
    """
    problems: list[str] = []
    notes: list[str] = []
    sessions: set[str] = set()
    labels = rows = erased = 0
    try:
        directories = shard_directories(data_dir)
    except JournalError as error:
        return Verification(ok=False, sessions=0, labels=0, rows=0, problems=(str(error),))
    for directory in directories:
        try:
            found = _audited(directory)
        except JournalError as error:
            problems.append(str(error))
            continue
        problems += found.problems
        if is_interrupted(directory) and not is_owned(directory):
            problems.append(f"{directory}: an erasing was interrupted; the next open completes it")
        problems += _epoch_problems(directory, found)
        notes += _notes(directory, found)
        problems += [
            f"{directory}: session {name} is in another shard too" for name in found.sessions & sessions
        ]
        sessions |= found.sessions
        labels += found.labels
        rows += found.seq
        erased += found.erased
    return Verification(not problems, len(sessions), labels, rows, tuple(problems), tuple(notes), erased)


def read_rows(data_dir: Path, session: str | None = None) -> Iterator[Row]:
    """Yield the durable rows of all shards in order, also while a writer lives.

    On a shard nobody writes, rows that only the mirror holds follow those of SQLite: the commit a crash
    interrupted, or what a damaged WAL lost. Proving the rows is `verify`'s part.

    Raises:
        JournalError: there is no journal, or it cannot be read.
    """
    for directory in shard_directories(data_dir):
        live = is_owned(directory)
        path = directory / SQLITE_NAME
        with translated(path), closing(open_read_only(directory, live=live)) as db:
            last = read_head(db, path).seq
            records = read_records(db, session, 0, last)
            amendments = read_amendments(body for _, _, body in read_amended_rows(db))
            yield from amended(records, amendments)
        if not live:
            tail = (
                record
                for record in _mirrored_after(directory, last)
                if session in (None, record.session) and record.kind != AMENDED_KIND
            )
            yield from (record.row for record in tail)


def _audited(directory: Path) -> Audit:
    live = is_owned(directory)
    found = audit(directory, live=live)
    if not live and is_owned(directory):
        # A writer came while the files were read; what looked like damage may have been its commit.
        found = audit(directory, live=True)
    return found


def _notes(directory: Path, found: Audit) -> Iterator[str]:
    if found.ahead:
        yield f"{directory}: {len(found.ahead)} rows are in the mirror alone; the next open completes SQLite"
    if found.behind:
        yield f"{directory}: {len(found.behind)} rows are in SQLite alone; the next open completes the mirror"
    if found.torn_bytes:
        yield f"{directory}: {found.torn_bytes} bytes of an unfinished write; the next open cuts them"


def _epoch_problems(directory: Path, found: Audit) -> Iterator[str]:
    try:
        epoch = read_epoch(directory) or 0
    except JournalError as error:
        yield str(error)
        return
    # A writer raises SQLite's first and the file's a moment later; a crash between leaves them one apart.
    if found.head is not None and abs(found.head.epoch - epoch) > 1:
        yield f"{directory}: epoch {epoch} in the file, {found.head.epoch} in SQLite; the next open mends it"


def _mirrored_after(directory: Path, seq: int) -> Iterator[Record]:
    try:
        mirror = MirrorReader(directory)
    except JournalError:
        return
    with mirror:
        for group in mirror.groups():
            for record in decode_group(group.payload):
                if record.seq > seq:
                    yield record
