"""What can go wrong with a journal; every message is one line: what is wrong, where, and the mend."""

from __future__ import annotations

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class JournalError(Exception):
    """The journal cannot do what was asked; nothing that was acknowledged is lost."""


class JournalLocked(JournalError):  # noqa: N818 - a state the caller reports, named as in the operations guide
    """Another process owns the shard."""


class JournalFull(JournalError):  # noqa: N818 - as above
    """No space is left; free some and commit again, no restart needed."""


class JournalFenced(JournalError):  # noqa: N818 - as above
    """A newer owner has taken the shard over; this writer must stop."""


class JournalDuplicate(JournalError):  # noqa: N818 - as above
    """The session already has a row with this unique id."""


class JournalNewer(JournalError):  # noqa: N818 - as above
    """The files were written by a newer version of the program."""


class JournalDamaged(JournalError):  # noqa: N818 - as above
    """Rows are in neither file, so opening is refused rather than going on with fewer.

    Attributes:
        missing: how many rows, at least, were found in neither file.
    """

    def __init__(self, message: str, missing: int) -> None:
        super().__init__(message)
        self.missing = missing


_FULL = frozenset({errno.ENOSPC, errno.EDQUOT})


SQLITE_ERRORS = (sqlite3.Error, UnicodeDecodeError)
"""What a damaged file makes the sqlite3 module raise: it also fails at messages that quote damaged names."""


@contextmanager
def translated(where: Path) -> Iterator[None]:
    """Turn errors of the file system and of SQLite about `where` into `JournalFull` or `JournalError`."""
    try:
        yield
    except (OSError, *SQLITE_ERRORS) as error:
        raise journal_error(where, error) from error


def journal_error(where: Path, error: OSError | sqlite3.Error | UnicodeDecodeError) -> JournalError:
    """Return the error to raise for what went wrong at `where`."""
    if isinstance(error, SQLITE_ERRORS):
        # The low byte is the primary result code; the rest says which system call failed.
        is_full = getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_FULL
    else:
        is_full = error.errno in _FULL
    if is_full:
        return JournalFull(f"{where}: no space left; free some, the journal then goes on by itself")
    if isinstance(error, SQLITE_ERRORS):
        return JournalError(f"{where}: {error}; check the disk, then run `sfid verify`")
    return JournalError(f"{where}: {error.strerror or error}; check the path and the disk")
