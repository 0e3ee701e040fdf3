"""A shard's files brought into one sound state under its lock, and taken over by a new epoch."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from services.runtime.journal.audit import Audit, audit
from services.runtime.journal.beside import Meanwhile, audit_beside
from services.runtime.journal.erasing import finish_erasing
from services.runtime.journal.errors import JournalDamaged, JournalError, translated
from services.runtime.journal.lock import read_epoch, write_epoch
from services.runtime.journal.mirror import MIRROR_NAME, SHARD_ID_BYTES, Mirror, create_mirror, sync_directory
from services.runtime.journal.salvage import rebuild
from services.runtime.journal.store import SQLITE_NAME, Head, Store, create_store, upgrade


class Opened(NamedTuple):
    """Both files open for writing, equal, and owned by `head.epoch`.

    Attributes:
        notes: what had to be mended, one line each.
        read_ahead: how many of the rows were read by `meanwhile`, as they are.
    """

    store: Store
    mirror: Mirror
    head: Head
    notes: tuple[str, ...]
    read_ahead: int


def open_files(
    directory: Path, mirror_type: type[Mirror] = Mirror, meanwhile: Meanwhile | None = None
) -> Opened:
    """Create, repair or simply open the files of a shard whose lock is held.

    Args:
        directory: the shard.
        mirror_type: what writes the mirror.
        meanwhile: see `audit_beside`.

    Raises:
        JournalNewer, JournalDamaged, JournalFull, JournalError: as for `Shard.open`.
    """
    upgraded = upgrade(directory)
    finished = finish_erasing(directory)
    notes, found, read_ahead = _recovered(directory, meanwhile)
    notes = (*finished, *notes)
    if upgraded:
        notes = (f"{directory / SQLITE_NAME}: written by an older version, brought to this one", *notes)
    store = Store(directory)
    try:
        head = store.take_over(_epoch_or_zero(directory) + 1)
        if found.head is None or (head.seq, head.chain) != (found.head.seq, found.head.chain):
            # An older owner, cut off only now, committed while the files were read.
            found, read_ahead = _sound(directory), 0
        if found.ahead:
            store.advance(head.epoch, found.ahead[-1])
            store.commit(found.ahead)
            notes = (*notes, f"{store.path}: {len(found.ahead)} rows completed from the mirror")
        mirror, mended = _opened_mirror(directory, found, mirror_type)
        try:
            write_epoch(directory, head.epoch)
        except BaseException:
            mirror.close()
            raise
    except BaseException:
        store.close()
        raise
    head = head._replace(seq=found.seq, chain=found.chain)
    return Opened(store, mirror, head, (*notes, *mended), read_ahead)


def _opened_mirror(
    directory: Path, found: Audit, mirror_type: type[Mirror]
) -> tuple[Mirror, tuple[str, ...]]:
    """Return the mirror, cut behind its last whole frame and completed from SQLite, and what was mended."""
    notes: tuple[str, ...] = ()
    mirror = mirror_type(directory, found.mirror_end)
    try:
        mirror.cut()
        if found.torn_bytes:
            notes = (f"{mirror.path}: {found.torn_bytes} bytes of an unfinished write cut",)
        if found.behind:
            mirror.write(b"".join(found.behind))
            mirror.start_sync()
            mirror.wait_synced()
            mirror.settle()
            notes = (*notes, f"{mirror.path}: {len(found.behind)} rows completed from SQLite")
    except BaseException:
        mirror.close()
        raise
    return mirror, notes


def _recovered(directory: Path, meanwhile: Meanwhile | None) -> tuple[tuple[str, ...], Audit, int]:
    if not any((directory / name).exists() for name in (SQLITE_NAME, MIRROR_NAME)):
        _create(directory)
    if meanwhile is None:
        found, read_ahead = audit(directory, live=False), 0
    else:
        found, read_ahead = audit_beside(directory, meanwhile)
    if not found.problems:
        return (), found, read_ahead
    rebuilt = rebuild(directory)
    return (*found.problems, *rebuilt), _sound(directory), 0


def _sound(directory: Path) -> Audit:
    found = audit(directory, live=False)
    if found.problems:
        message = f"{found.problems[0]}; the repair did not hold, check the disk"
        raise JournalError(message)
    return found


def _create(directory: Path) -> None:
    # An epoch was given out, so there were rows to lose.
    if _epoch_or_zero(directory):
        message = f"{directory}: both journal files are missing; restore a backup or remove the directory"
        raise JournalDamaged(message, missing=1)
    shard_id = os.urandom(SHARD_ID_BYTES)
    create_mirror(directory / MIRROR_NAME, shard_id, ())
    create_store(directory / SQLITE_NAME, shard_id, 0, ())
    with translated(directory):
        sync_directory(directory)
        sync_directory(directory.parent)


def _epoch_or_zero(directory: Path) -> int:
    try:
        return read_epoch(directory) or 0
    except JournalError:
        # Damaged; SQLite holds the epoch too, and the higher of the two is raised.
        return 0
