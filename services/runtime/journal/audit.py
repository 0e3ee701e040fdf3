"""Both files of a shard read side by side: what they prove together, and where they disagree.

The chain is recomputed from the SQLite rows alone; the mirror is then compared with the recomputed bytes. So
every row is proven three times for the price of one pass: by its hashes, by its frame's CRC, and by being
equal in both files.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from protocol.framing import Frame, is_torn_tail
from services.runtime.journal.chain import BrokenChainError, Prover, Record, decode_group, genesis
from services.runtime.journal.errors import SQLITE_ERRORS, JournalError, JournalNewer
from services.runtime.journal.mirror import TITLE_FRAME_BYTES, MirrorReader
from services.runtime.journal.store import (
    OLDER_HEAD,
    SCHEMA,
    SQLITE_NAME,
    Head,
    is_older,
    open_read_only,
    read_head,
    read_tuples,
)

LABEL_KIND = "answer"
THREAD_BYTES = 16 * 2**20
"""A smaller file is checked sooner than a thread is started."""


@dataclass(slots=True)
class Audit:
    """What a pass over one shard found.

    Attributes:
        seq: how many rows are proven, counted from the first.
        chain: the chain value after the last proven row.
        labels: how many of them are answers.
        erased: how many of those were erased.
        sessions: the sessions they belong to.
        head: SQLite's head, None when it could not be read.
        ahead: rows behind SQLite's head that only the mirror holds, proven; `seq` counts them.
        ahead_commits: in how many commits they were written.
        behind: canonical bytes of the rows of SQLite's last commit, when the mirror ends before it; counted.
        mirror_end: the offset behind the last proven frame.
        torn_bytes: how many bytes of an unfinished write follow it.
        problems: one line each, empty when all is proven.
    """

    seq: int = 0
    chain: bytes = b""
    labels: int = 0
    erased: int = 0
    sessions: set[str] = field(default_factory=set)
    head: Head | None = None
    ahead: list[Record] = field(default_factory=list)
    ahead_commits: int = 0
    behind: list[bytes] = field(default_factory=list)
    mirror_end: int = TITLE_FRAME_BYTES
    torn_bytes: int = 0
    problems: list[str] = field(default_factory=list)
    prover: Prover | None = None

    def take(self, record: Record, mirrored: bytes | None = None, at: int = 0) -> bytes:
        """Prove the next row, also against `mirrored` at `at`; return its canonical bytes.

        Raises:
            BrokenChainError: it does not follow, or is not what stands in `mirrored`.
        """
        if self.prover is None:
            self.prover = Prover(self.chain)
        encoded = self.prover.prove(record)
        seq = record[0]
        if seq != self.seq + 1 or (mirrored is not None and not mirrored.startswith(encoded, at)):
            raise BrokenChainError(seq)
        self.seq = seq
        self.chain = self.prover.chain
        self.sessions.add(record[1])
        if record[2] == LABEL_KIND:
            self.labels += 1
            self.erased += record[7] is None
        return encoded


def audit(directory: Path, *, live: bool) -> Audit:
    """Read one shard and report; changes nothing.

    Args:
        directory: the shard.
        live: whether a writer owns it; then what the mirror holds behind SQLite's head is on its way.

    Raises:
        JournalNewer: the files are of a newer version, so nothing can be said about them.
    """
    found = Audit()
    try:
        with closing(open_read_only(directory, live=live)) as db:
            structure = _Structure(directory, db, live=live)
            try:
                _compare(found, directory, db, live=live)
            finally:
                problems = structure.problems()
            found.problems += problems
    except JournalNewer:
        raise
    except JournalError as error:
        found.problems.append(str(error))
    except SQLITE_ERRORS as error:
        found.problems.append(
            f"{directory / SQLITE_NAME}: {error}; opening the shard repairs it from the mirror"
        )
    return found


class _Structure:
    """The check of schema and indexes; of a large file on a thread of its own, beside the walk over rows."""

    def __init__(self, directory: Path, db: sqlite3.Connection, *, live: bool) -> None:
        self._directory, self._db, self._live = directory, db, live
        self._found: list[str] | sqlite3.Error | UnicodeDecodeError | JournalError = []
        self._thread: threading.Thread | None = None
        if (directory / SQLITE_NAME).stat().st_size > THREAD_BYTES:
            self._thread = threading.Thread(target=self._check, name="journal-structure")
            self._thread.start()

    def problems(self) -> list[str]:
        """Return what is wrong, once all was looked at; raises sqlite3.Error or JournalError."""
        if self._thread is None:
            return structure_problems(self._db)
        self._thread.join()
        if isinstance(self._found, Exception):
            raise self._found
        return self._found

    def _check(self) -> None:
        try:
            with closing(open_read_only(self._directory, live=self._live)) as db:
                self._found = structure_problems(db)
        except (*SQLITE_ERRORS, JournalError) as error:
            self._found = error


def structure_problems(db: sqlite3.Connection) -> list[str]:
    """Return what is wrong with the schema and the indexes; raises sqlite3.Error."""
    wanted = dict(SCHEMA) | ({"head": OLDER_HEAD} if is_older(db) else {})
    seen = dict(db.execute("SELECT name, sql FROM sqlite_schema").fetchall())
    problems = [] if seen == wanted else [f"{SQLITE_NAME}: its tables are not those that were created"]
    checked = [str(line) for (line,) in db.execute("PRAGMA integrity_check(3)").fetchall()]
    if checked != ["ok"]:
        problems.append(f"{SQLITE_NAME}: {'; '.join(' '.join(line.split()) for line in checked)}")
    return problems


def _compare(found: Audit, directory: Path, db: sqlite3.Connection, *, live: bool) -> None:
    db.execute("BEGIN")
    head = found.head = read_head(db, directory / SQLITE_NAME)
    (last,) = db.execute("SELECT coalesce(max(seq), 0) FROM rows").fetchone()
    db.execute("COMMIT")
    # Rows stay the plain tuples that SQLite made: there may be millions, and only their places are looked at.
    records = cast("Iterator[Record]", read_tuples(db, None, 0, head.seq))
    # Opened after the head was read: all but SQLite's last commit was in the mirror by then.
    with MirrorReader(directory) as mirror:
        if mirror.shard_id != head.shard_id or last != head.seq or not 0 <= head.seq_before <= last:
            found.problems.append(f"{directory}: the head in {SQLITE_NAME} is damaged")
            return
        found.chain = genesis(head.shard_id)
        _walk(found, head, records, mirror, live=live)
        if not found.problems and not live:
            _judge_tail(found, mirror)


def _walk(found: Audit, head: Head, records: Iterator[Record], mirror: MirrorReader, *, live: bool) -> None:
    try:
        for group in mirror.groups():
            if found.seq < head.seq:
                _match(found, records, group)
            elif live:
                return
            else:
                _check_head(found, head)
                _run_ahead(found, group)
            found.mirror_end = group.end
        if found.seq == head.seq_before:
            rest = [found.take(record) for record in records]
            found.behind = [] if live else rest
        if found.seq < head.seq:
            found.problems.append(f"{mirror.path}: ends at row {found.seq}, SQLite at row {head.seq}")
        elif not found.ahead:
            _check_head(found, head)
    except (BrokenChainError, ValueError):
        found.problems.append(
            f"{mirror.path.parent}: row {found.seq + 1} does not hold: a hash or the other file disagrees"
        )


def _match(found: Audit, records: Iterator[Record], group: Frame) -> None:
    payload = group.payload
    at = 0
    while at < len(payload):
        record = next(records, None)
        if record is None:
            raise BrokenChainError(found.seq + 1)
        at += len(found.take(record, payload, at))


def _check_head(found: Audit, head: Head) -> None:
    if found.seq == head.seq and found.chain != head.chain:
        raise BrokenChainError(found.seq)


def _run_ahead(found: Audit, group: Frame) -> None:
    found.ahead_commits += 1
    for record in decode_group(group.payload):
        found.take(record)
        found.ahead.append(record)


def _judge_tail(found: Audit, mirror: MirrorReader) -> None:
    rest = mirror.rest()
    if is_torn_tail(rest):
        found.torn_bytes = len(rest)
    else:
        found.problems.append(f"{mirror.path}: damaged behind row {found.seq}, before its end")
