"""A large shard audited by a process of its own, while its owner already reads what is not proven yet.

Proving a row and rebuilding a session from it cost about the same, and the interpreter does one thing at a
time. What was read ahead counts only if the audit then finds nothing to mend.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

from services.runtime.journal.amend import AMENDED_KIND, read_amendments, readable_events
from services.runtime.journal.audit import Audit, audit
from services.runtime.journal.store import (
    SQLITE_NAME,
    open_read_only,
    read_amended_rows,
    read_events,
    read_head,
    read_sessions,
)

BESIDE_BYTES = 16 * 2**20
"""Of SQLite's file: a smaller shard is proven sooner than a process is started."""
_PROGRAM = f"from {__name__} import tell; tell()"


class UnprovenRows:
    """A shard's rows as SQLite holds them, of which nobody knows yet whether they hold.

    Attributes:
        seq: how many there are. All methods raise what a damaged file makes them raise.
    """

    def __init__(self, directory: Path) -> None:
        """Open the file of a shard whose lock is held."""
        self._db = open_read_only(directory, live=False)
        self.seq = read_head(self._db, directory / SQLITE_NAME).seq
        self._amendments = read_amendments(body for _, _, body in read_amended_rows(self._db))

    def sessions(self) -> list[str]:
        """Return the sessions that have rows, in the order of their first ones."""
        return read_sessions(self._db)

    def events(self, session: str) -> Iterator[tuple[str, int, bytes]]:
        """Yield rows as `Shard.events` does."""
        return readable_events(read_events(self._db, session, 0, self.seq), self._amendments)

    def close(self) -> None:
        """Close the file."""
        self._db.close()


Meanwhile = Callable[[UnprovenRows], None]
"""Reads ahead. What it does must be undone by forgetting it."""


def audit_beside(directory: Path, meanwhile: Meanwhile) -> tuple[Audit, int]:
    """Audit a shard whose lock is held; return what was found, and how many rows were rightly read ahead.

    `meanwhile` is not called for a small shard, nor where no process can be started; that is 0 rows, too.

    Raises: JournalNewer, as `audit`; anything but an Exception that `meanwhile` raises.
    """
    process = _started(directory)
    if process is None:
        return audit(directory, live=False), 0
    with process:
        try:
            seq = _read_ahead(directory, meanwhile)
            told, _ = process.communicate()
        except BaseException:
            process.kill()
            raise
    if process.returncode != 0:  # this process says why, or does better
        return audit(directory, live=False), 0
    found: Audit = pickle.loads(told)  # noqa: S301 - written by our own process, through a pipe
    holds = not found.problems and found.head is not None and found.head.seq == seq
    # Amendments change how earlier rows are read.
    return found, seq if holds and all(record.kind != AMENDED_KIND for record in found.ahead) else 0


def _started(directory: Path) -> subprocess.Popen[bytes] | None:
    path = directory / SQLITE_NAME
    try:
        if path.stat().st_size < BESIDE_BYTES:
            return None
        return subprocess.Popen(
            # -P: what lies in the working directory is no part of the program.
            [sys.executable, "-P", "-c", _PROGRAM, str(directory)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the process that asked
        )
    except OSError:
        return None


def _read_ahead(directory: Path, meanwhile: Meanwhile) -> int:
    try:
        with closing(UnprovenRows(directory)) as rows:
            meanwhile(rows)
            return rows.seq
    except Exception:  # noqa: BLE001 - of unproven rows: the audit says what is wrong, and all is read again
        return 0


def tell() -> None:
    """Audit the shard that the command line names and write what was found to the standard output."""
    found = audit(Path(sys.argv[1]), live=False)
    found.prover = None
    with os.fdopen(sys.stdout.fileno(), "wb", closefd=False) as output:
        pickle.dump(found, output)
