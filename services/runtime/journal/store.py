"""The SQLite side of a shard: exactly one connection writes it, everybody else opens it read-only."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from services.runtime.journal.amend import AMENDED_KIND
from services.runtime.journal.chain import Record, genesis
from services.runtime.journal.errors import (
    SQLITE_ERRORS,
    JournalError,
    JournalFenced,
    JournalFull,
    JournalNewer,
    journal_error,
    translated,
)

SQLITE_NAME = "journal.sqlite"
APPLICATION_ID = 0x53664944  # "SfID"
SCHEMA_VERSION = 2
# One statement fetches this many rows: a slow reader holds no snapshot that would stop a checkpoint.
BATCH_ROWS = 4096

SCHEMA = {
    "head": "CREATE TABLE head (one INTEGER PRIMARY KEY CHECK (one = 1), shard_id BLOB NOT NULL, "
    "epoch INTEGER NOT NULL, seq INTEGER NOT NULL, chain BLOB NOT NULL, "
    "seq_before INTEGER NOT NULL) STRICT",
    "rows": "CREATE TABLE rows (seq INTEGER PRIMARY KEY, session TEXT NOT NULL, kind TEXT NOT NULL, "
    "at_ns INTEGER NOT NULL, answer_id BLOB, person TEXT, salt BLOB, body BLOB, "
    "seal BLOB NOT NULL, chain BLOB NOT NULL) STRICT",
    "rows_answer": "CREATE UNIQUE INDEX rows_answer ON rows (session, answer_id) WHERE answer_id IS NOT NULL",
    "rows_session": "CREATE INDEX rows_session ON rows (session)",
}

OLDER_HEAD = (
    "CREATE TABLE head (one INTEGER PRIMARY KEY CHECK (one = 1), shard_id BLOB NOT NULL, "
    "epoch INTEGER NOT NULL, seq INTEGER NOT NULL, chain BLOB NOT NULL) STRICT"
)
"""Of version 1, whose mirror was synced before each commit: SQLite was never ahead of it."""

_COLUMNS = "seq, session, kind, at_ns, answer_id, person, salt, body, seal, chain"
_INSERT = f"INSERT INTO rows ({_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"  # noqa: S608 - constants
_SELECT = f"SELECT {_COLUMNS} FROM rows"  # noqa: S608 - constants
_FIND = f"{_SELECT} WHERE session = ? AND answer_id = ? AND answer_id IS NOT NULL"
_WITHIN = f"seq > ? AND seq <= ? ORDER BY seq LIMIT {BATCH_ROWS}"
_PAGE = f"{_SELECT} WHERE {_WITHIN}"
_PAGE_OF_SESSION = f"{_SELECT} INDEXED BY rows_session WHERE session = ? AND {_WITHIN}"
_EVENTS = (
    "SELECT seq, kind, at_ns, body FROM rows INDEXED BY rows_session "  # noqa: S608 - constants
    f"WHERE session = ? AND {_WITHIN}"
)
_AMENDED = "SELECT seq, session, body FROM rows WHERE kind = ? AND body IS NOT NULL ORDER BY seq"
_HEAD = "shard_id, epoch, seq, chain, seq_before"
_FIRST_HEAD = f"INSERT INTO head (one, {_HEAD}) VALUES (1, ?, ?, ?, ?, ?)"  # noqa: S608 - constants
_READ_HEAD = f"SELECT {_HEAD} FROM head WHERE one = 1"  # noqa: S608 - constants
_READ_OLDER_HEAD = "SELECT shard_id, epoch, seq, chain, seq FROM head WHERE one = 1"
# On the right of an assignment `seq` is still the old one.
_ADVANCE = "UPDATE head SET seq_before = seq, seq = ?, chain = ? WHERE one = 1 AND epoch = ?"


class Head(NamedTuple):
    """Where the chain stands and who may lengthen it.

    Attributes:
        seq_before: where it stood before the last commit; a crash may leave the mirror there, nowhere else.
    """

    shard_id: bytes
    epoch: int
    seq: int
    chain: bytes
    seq_before: int


class Store:
    """The one read-write connection to a shard's SQLite file; not for two threads at once.

    Raises:
        JournalFull, JournalError: from every method, when the disk or the file is at fault.
        JournalFenced: from `advance`, when a newer epoch owns the file.
    """

    def __init__(self, directory: Path) -> None:
        """Open the existing file in `directory`."""
        self.path = directory / SQLITE_NAME
        with translated(self.path):
            self._db = sqlite3.connect(
                _uri(self.path, "mode=rw"), uri=True, isolation_level=None, check_same_thread=False
            )
            try:
                _configure(self._db)
                check_version(self._db, self.path)
            except BaseException:
                self._db.close()
                raise

    def head(self) -> Head:
        """Return the head as committed."""
        with translated(self.path):
            return read_head(self._db, self.path)

    def take_over(self, epoch_min: int) -> Head:
        """Durably raise the epoch to at least `epoch_min` and above every earlier one; return the head."""
        with translated(self.path):
            self._db.execute("BEGIN IMMEDIATE")
            head = read_head(self._db, self.path)
            epoch = max(head.epoch + 1, epoch_min)
            self._db.execute("UPDATE head SET epoch = ? WHERE one = 1", (epoch,))
            self._db.execute("COMMIT")
        return head._replace(epoch=epoch)

    def advance(self, epoch: int, last: Record) -> None:
        """Begin a transaction that owns the file at `epoch` and in which the head stands at row `last`."""
        with translated(self.path):
            self._db.execute("BEGIN IMMEDIATE")
            if self._db.execute(_ADVANCE, (last.seq, last.chain, epoch)).rowcount != 1:
                message = f"{self.path}: a newer learner has taken this shard over; stop this one"
                raise JournalFenced(message)

    def commit(self, records: Sequence[Record]) -> None:
        """Put the rows into the transaction and make it durable: one sync of the WAL."""
        with translated(self.path):
            self._db.executemany(_INSERT, records)
            self._db.execute("COMMIT")

    def roll_back(self) -> None:
        """Drop the transaction when there is one."""
        with translated(self.path):
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")

    def find(self, session: str, unique: bytes) -> Record | None:
        """Return the committed row with this unique id."""
        # Asked for every answer, so without the cost of a context manager.
        try:
            found = self._db.execute(_FIND, (session, unique)).fetchone()
        except SQLITE_ERRORS as error:
            raise journal_error(self.path, error) from error
        return None if found is None else Record._make(found)

    def records(self, session: str | None, after_seq: int, through_seq: int) -> Iterator[Record]:
        """Yield committed rows in order."""
        with translated(self.path):
            yield from read_records(self._db, session, after_seq, through_seq)

    def events(
        self, session: str, after_seq: int, through_seq: int
    ) -> Iterator[tuple[int, str, int, bytes | None]]:
        """Yield (seq, kind, at_ns, body) of a session's committed rows in order."""
        with translated(self.path):
            yield from read_events(self._db, session, after_seq, through_seq)

    def amended_rows(self) -> list[tuple[int, str, bytes]]:
        """Return (seq, session, body) of the rows that say what is read in place of erased ones."""
        with translated(self.path):
            return read_amended_rows(self._db)

    def sessions(self) -> list[str]:
        """Return the sessions that have committed rows, in the order of their first ones."""
        with translated(self.path):
            return read_sessions(self._db)

    def checkpoint(self) -> None:
        """Write every page from the WAL into the database file, with fresh writes and syncs of both."""
        with translated(self.path):
            self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    def close(self) -> None:
        """Close the connection; SQLite drops an open transaction."""
        self._db.close()


def create_store(path: Path, shard_id: bytes, epoch: int, records: Sequence[Record]) -> None:
    """Write a new SQLite file at `path` (which must not exist) that holds `records`, durable on return."""
    head = (
        Head(shard_id, epoch, records[-1].seq, records[-1].chain, records[-1].seq)
        if records
        else Head(shard_id, epoch, 0, genesis(shard_id), 0)
    )
    with translated(path):
        # SQLite gives the file its own mode; creating it first keeps it private from its first byte.
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
        db = sqlite3.connect(_uri(path, "mode=rw"), uri=True, isolation_level=None)
        try:
            _configure(db)
            db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            db.execute("BEGIN IMMEDIATE")
            for statement in SCHEMA.values():
                db.execute(statement)
            db.execute(_FIRST_HEAD, head)
            db.executemany(_INSERT, records)
            db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            db.execute("COMMIT")
            db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        finally:
            db.close()


def open_read_only(directory: Path, *, live: bool) -> sqlite3.Connection:
    """Open a shard's SQLite file for reading; raises sqlite3.Error or JournalError.

    Args:
        directory: the shard.
        live: whether a writer owns it. Without one, and with nothing left in a WAL, the file is read as it
            lies, so that a copy on read-only media can be checked.
    """
    path = directory / SQLITE_NAME
    if not path.exists():
        message = f"{path}: the file is missing; opening the shard rebuilds it from the mirror"
        raise JournalError(message)
    wal = path.with_name(path.name + "-wal")
    settled = not live and (not wal.exists() or wal.stat().st_size == 0)
    mode = "mode=ro&immutable=1" if settled else "mode=ro"
    db = sqlite3.connect(_uri(path, mode), uri=True, isolation_level=None, check_same_thread=False)
    try:
        db.execute("PRAGMA busy_timeout = 5000")
        check_version(db, path)
    except BaseException:
        db.close()
        raise
    return db


def check_version(db: sqlite3.Connection, path: Path) -> None:
    """Refuse a file of another program or (JournalError) or of a newer version (JournalNewer)."""
    (application,) = db.execute("PRAGMA application_id").fetchone()
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if application != APPLICATION_ID or version < 1:
        message = f"{path}: not a journal of this program; name the right directory or restore a backup"
        raise JournalError(message)
    if version > SCHEMA_VERSION:
        message = (
            f"{path}: written by a newer version (schema {version}, known {SCHEMA_VERSION}); upgrade sfid"
        )
        raise JournalNewer(message)


def is_older(db: sqlite3.Connection) -> bool:
    """Tell whether the head is that of an older version; raises sqlite3.Error."""
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if version >= SCHEMA_VERSION:
        return False
    (sql,) = db.execute("SELECT sql FROM sqlite_schema WHERE name = 'head'").fetchone() or (None,)
    return bool(sql == OLDER_HEAD)


def upgrade(directory: Path) -> bool:
    """Bring an older SQLite file to this version, in one commit; tell whether it was one.

    A file that cannot be read is left to the audit, which is next to look at it. Raises: JournalFull.
    """
    path = directory / SQLITE_NAME
    if not path.exists():
        return False
    try:
        with closing(sqlite3.connect(_uri(path, "mode=rw"), uri=True, isolation_level=None)) as db:
            _configure(db)
            check_version(db, path)
            (version,) = db.execute("PRAGMA user_version").fetchone()
            if version == SCHEMA_VERSION:
                return False
            db.execute("BEGIN IMMEDIATE")
            if is_older(db):
                head = read_head(db, path)
                db.execute("DROP TABLE head")
                db.execute(SCHEMA["head"])
                db.execute(_FIRST_HEAD, head)
            db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            db.execute("COMMIT")
    except (*SQLITE_ERRORS, JournalError) as error:
        failure = error if isinstance(error, JournalError) else journal_error(path, error)
        if isinstance(failure, (JournalFull, JournalNewer)):
            raise failure from error
        return False
    return True


def read_head(db: sqlite3.Connection, path: Path) -> Head:
    """Return the committed head; JournalError when its row is not what was written."""
    older = is_older(db)
    found = db.execute(_READ_OLDER_HEAD if older else _READ_HEAD).fetchone()
    if found is None:
        message = f"{path}: its head is missing; opening the shard rebuilds it from the mirror"
        raise JournalError(message)
    return Head._make(found)


def read_records(
    db: sqlite3.Connection, session: str | None, after_seq: int, through_seq: int
) -> Iterator[Record]:
    """Yield rows in order, a batch a statement; raises sqlite3.Error."""
    return map(Record._make, read_tuples(db, session, after_seq, through_seq))


def read_tuples(
    db: sqlite3.Connection, session: str | None, after_seq: int, through_seq: int
) -> Iterator[tuple[Any, ...]]:
    """Yield rows as SQLite returns them, otherwise as `read_records`."""
    while True:
        if session is None:
            batch = db.execute(_PAGE, (after_seq, through_seq)).fetchall()
        else:
            batch = db.execute(_PAGE_OF_SESSION, (session, after_seq, through_seq)).fetchall()
        yield from batch
        if len(batch) < BATCH_ROWS:
            return
        after_seq = batch[-1][0]


def read_events(
    db: sqlite3.Connection, session: str, after_seq: int, through_seq: int
) -> Iterator[tuple[int, str, int, bytes | None]]:
    """Yield (seq, kind, at_ns, body) of a session's rows in order; raises sqlite3.Error."""
    while True:
        batch = db.execute(_EVENTS, (session, after_seq, through_seq)).fetchall()
        yield from batch
        if len(batch) < BATCH_ROWS:
            return
        after_seq = batch[-1][0]


def read_sessions(db: sqlite3.Connection) -> list[str]:
    """Return the sessions that have rows, in the order of their first ones; raises sqlite3.Error."""
    return [name for (name,) in db.execute("SELECT session FROM rows GROUP BY session ORDER BY MIN(seq)")]


def read_amended_rows(db: sqlite3.Connection) -> list[tuple[int, str, bytes]]:
    """Return (seq, session, body) of the `amended` rows that stand; raises sqlite3.Error."""
    return db.execute(_AMENDED, (AMENDED_KIND,)).fetchall()


def _configure(db: sqlite3.Connection) -> None:
    db.execute("PRAGMA busy_timeout = 5000")
    db.execute("PRAGMA journal_mode = WAL").fetchall()
    db.execute("PRAGMA synchronous = FULL")
    db.execute("PRAGMA temp_store = MEMORY")
    db.execute("PRAGMA cache_size = -32768")


def _uri(path: Path, query: str) -> str:
    return f"{path.absolute().as_uri()}?{query}"
