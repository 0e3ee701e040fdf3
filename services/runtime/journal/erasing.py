"""Erasing, so that no file of a shard keeps the bytes: both files are written anew without them.

A marker stands in the directory from before the intention is committed (the `amended` rows, which list what
is to be erased) until both files are new. An opening that finds it does the same again: with the intention
committed the erasing is completed, without it everything stays.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from services.runtime.journal.amend import AMENDED_KIND, erased, read_amendments
from services.runtime.journal.chain import Record, genesis, proven, rechained
from services.runtime.journal.errors import JournalError, translated
from services.runtime.journal.mirror import MIRROR_NAME, create_mirror, sync_directory
from services.runtime.journal.salvage import fresh, proven_rows
from services.runtime.journal.store import SQLITE_NAME, create_store

MARKER_NAME = "erasing"


def is_interrupted(directory: Path) -> bool:
    """Tell whether an erasing was begun here and did not end."""
    return (directory / MARKER_NAME).exists()


def begin_erasing(directory: Path, renamed: Mapping[str, str]) -> None:
    """Note durably that what follows is to be completed, and which sessions get another name then."""
    new = directory / (MARKER_NAME + ".new")
    with translated(directory):
        fd = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        try:
            os.write(fd, json.dumps(dict(renamed)).encode())
            os.fsync(fd)
        finally:
            os.close(fd)
        new.replace(directory / MARKER_NAME)
        sync_directory(directory)


def finish_erasing(directory: Path) -> tuple[str, ...]:
    """Write both files without what is to be erased, under the lock; return what had to be done, a line.

    Files of earlier repairs, which hold people's data, are removed too.
    Raises: JournalDamaged, JournalFull, JournalError; the marker stays, and the next opening tries again.
    """
    if not is_interrupted(directory):
        return ()
    shard_id, epoch, records = proven_rows(directory)
    intended = (record.body for record in records if record.kind == AMENDED_KIND and record.body is not None)
    try:
        gone = read_amendments(intended).keys()
    except ValueError as error:
        message = f"{directory}: {error}; restore the directory from a backup"
        raise JournalError(message) from None
    left = [erased(record) if record.seq in gone else record for record in records]
    left = _renamed(directory, shard_id, left)
    # The mirror first, as in a repair: it holds every row when SQLite's log is taken away.
    mirror = fresh(directory / (MIRROR_NAME + ".new"))
    create_mirror(mirror, shard_id, _encoded(shard_id, left))
    store = fresh(directory / (SQLITE_NAME + ".new"))
    create_store(store, shard_id, epoch, left)
    with translated(directory):
        mirror.replace(directory / MIRROR_NAME)
        sync_directory(directory)
        for suffix in ("-wal", "-shm"):
            (directory / (SQLITE_NAME + suffix)).unlink(missing_ok=True)
        store.replace(directory / SQLITE_NAME)
        for path in (*directory.glob("*.damaged-*"), *directory.glob("*.new*")):
            path.unlink()
        sync_directory(directory)
        (directory / MARKER_NAME).unlink()
        sync_directory(directory)
    return (f"{directory}: erased {len(gone)} rows, both files written anew",)


def _renamed(directory: Path, shard_id: bytes, records: list[Record]) -> list[Record]:
    """Give sessions the names that the marker says, those alone of which nothing is left but names."""
    try:
        wanted = json.loads((directory / MARKER_NAME).read_bytes())
    except (OSError, ValueError) as error:
        message = f"{directory / MARKER_NAME}: {error}; remove it, then say `sfid forget` again"
        raise JournalError(message) from None
    kept = {one.session for one in records if one.body is not None and one.kind != AMENDED_KIND}
    names = {old: new for old, new in wanted.items() if old not in kept}
    if not any(record.session in names for record in records):
        return records
    prev = genesis(shard_id)
    renamed = []
    for record in records:
        one = rechained(prev, record._replace(session=names.get(record.session, record.session)))
        renamed.append(one)
        prev = one.chain
    return renamed


def _encoded(shard_id: bytes, records: list[Record]) -> list[bytes]:
    encoded = []
    prev = genesis(shard_id)
    for record in records:
        encoded.append(proven(prev, record))
        prev = record.chain
    return encoded
