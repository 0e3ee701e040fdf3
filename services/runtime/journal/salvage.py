"""A damaged shard rebuilt from whatever of its two files still proves itself.

This path keeps the whole shard in memory; it runs only when the files disagree by more than an unfinished
commit.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from protocol.framing import whole_frames_within
from services.runtime.journal.audit import structure_problems
from services.runtime.journal.chain import HASH_BYTES, BrokenChainError, Record, decode_group, genesis, proven
from services.runtime.journal.errors import SQLITE_ERRORS, JournalDamaged, JournalError, translated
from services.runtime.journal.mirror import (
    MIRROR_NAME,
    SHARD_ID_BYTES,
    MirrorReader,
    create_mirror,
    sync_directory,
)
from services.runtime.journal.store import (
    BATCH_ROWS,
    SQLITE_NAME,
    Head,
    create_store,
    open_read_only,
    read_head,
    read_records,
)


@dataclass(slots=True)
class _Source:
    """What one file still holds.

    Attributes:
        shard_id: as the file says, None when it does not.
        records: by seq, unproven.
        intact: whether the file needs no rebuilding, provided its records are all of the shard's.
        head: SQLite's head.
    """

    shard_id: bytes | None = None
    records: dict[int, Record] = field(default_factory=dict)
    intact: bool = False
    head: Head | None = None


def rebuild(directory: Path) -> tuple[str, ...]:
    """Repair a shard's files from each other; return one line for each file that was rebuilt.

    The damaged file stays beside the new one, as NAME.damaged-N.

    Raises:
        JournalDamaged: rows are missing from both files; nothing was changed.
        JournalFull, JournalError: the new files could not be written.
    """
    mirror = _read_mirror(directory)
    store = _read_store(directory, max(mirror.records, default=0))
    shard_id, proof = _prove(directory, store, mirror)
    records = [record for record, _ in proof]
    notes = []
    # The mirror first: from then on one file holds everything, whatever happens to the other.
    if not mirror.intact or mirror.shard_id != shard_id or list(mirror.records.values()) != records:
        new = fresh(directory / (MIRROR_NAME + ".new"))
        create_mirror(new, shard_id, (encoded for _, encoded in proof))
        notes.append(_put_in_place(new, directory / MIRROR_NAME, len(records)))
    head, end = store.head, _end_of(records, shard_id)
    head_holds = head is not None and (head.shard_id, head.seq, head.chain) == (shard_id, *end)
    if not store.intact or not head_holds or list(store.records.values()) != records:
        new = fresh(directory / (SQLITE_NAME + ".new"))
        epoch = store.head.epoch if store.head is not None else 0
        create_store(new, shard_id, epoch, records)
        notes.append(_put_in_place(new, directory / SQLITE_NAME, len(records)))
    return tuple(notes)


def proven_rows(directory: Path) -> tuple[bytes, int, list[Record]]:
    """Return the shard's id, SQLite's epoch (0 when it cannot be read) and every row of either file, proven.

    Raises: JournalDamaged when rows are in neither.
    """
    mirror = _read_mirror(directory)
    store = _read_store(directory, max(mirror.records, default=0))
    shard_id, proof = _prove(directory, store, mirror)
    return shard_id, 0 if store.head is None else store.head.epoch, [record for record, _ in proof]


def _end_of(records: list[Record], shard_id: bytes) -> tuple[int, bytes]:
    return (records[-1].seq, records[-1].chain) if records else (0, genesis(shard_id))


def _prove(directory: Path, store: _Source, mirror: _Source) -> tuple[bytes, list[tuple[Record, bytes]]]:
    """Return the shard's id and every row with its canonical bytes, or raise JournalDamaged."""
    ids = [source.shard_id for source in (store, mirror) if source.shard_id is not None]
    last = max((*store.records, *mirror.records), default=0)
    best: tuple[bytes, list[tuple[Record, bytes]]] = (b"", [])
    for shard_id in ids:
        proof = _longest(shard_id, last, store, mirror)
        if not best[0] or len(proof) > len(best[1]):
            best = (shard_id, proof)
    shard_id, proof = best
    head = store.head
    end = _end_of([record for record, _ in proof], shard_id)
    # A head that names more rows is believed, unless its chain value or the mirror shows the chain ends here;
    # a mirror that ends where the head's last commit begins shows nothing: a crash leaves it so.
    short = (
        head is not None
        and head.seq > end[0]
        and head.chain != end[1]
        and (max(mirror.records, default=0) != end[0] or head.seq_before == end[0])
    )
    if shard_id and len(proof) == last and not short:
        return shard_id, proof
    claimed = max(last, head.seq) if short and head is not None else last
    missing = max(1, claimed - len(set(store.records) | set(mirror.records)))
    message = (
        f"{directory}: row {len(proof) + 1} of {claimed} is whole in neither file "
        f"(at least {missing} missing); restore the directory from a backup"
    )
    raise JournalDamaged(message, missing)


def _longest(shard_id: bytes, last: int, store: _Source, mirror: _Source) -> list[tuple[Record, bytes]]:
    prev = genesis(shard_id)
    proof: list[tuple[Record, bytes]] = []
    for seq in range(1, last + 1):
        candidates = [source.records[seq] for source in (store, mirror) if seq in source.records]
        # An erasure that reached one file is completed: no damage empties three columns and nothing else.
        candidates.sort(key=lambda record: record.body is not None)
        for record in candidates:
            encoded = _try(prev, record)
            if encoded is not None:
                proof.append((record, encoded))
                prev = record.chain
                break
        else:
            break
    return proof


def _try(prev: bytes, record: Record) -> bytes | None:
    try:
        return proven(prev, record)
    except BrokenChainError:
        return None


def _read_mirror(directory: Path) -> _Source:
    found = _Source()
    path = directory / MIRROR_NAME
    try:
        with MirrorReader(directory) as reader:
            if len(reader.shard_id) == SHARD_ID_BYTES:
                found.shard_id = reader.shard_id
            groups = [group.payload for group in reader.groups()]
            rest = reader.rest()
            found.intact = not rest
    except JournalError:
        groups = []
        with translated(path):
            rest = path.read_bytes() if path.exists() else b""
    groups += [one.payload for one in whole_frames_within(rest)]
    for group in groups:
        try:
            records = decode_group(group)
        except ValueError:
            # Such as the title frame, met while searching; a frame of rows passed its CRC and decodes.
            continue
        found.records.update((record.seq, record) for record in records)
    return found


def _read_store(directory: Path, mirrored: int) -> _Source:
    found = _Source()
    try:
        with closing(open_read_only(directory, live=False)) as db:
            head = read_head(db, directory / SQLITE_NAME)
            if _is_plausible(head):
                found.head = head
                found.shard_id = head.shard_id
            found.records = {record.seq: record for record in _readable(db, directory, mirrored)}
            found.intact = not structure_problems(db)
    except (JournalError, *SQLITE_ERRORS, TypeError):
        # Whatever was read so far is kept; the file is rebuilt.
        found.intact = False
    return found


def _is_plausible(head: Head) -> bool:
    # STRICT columns fix the types; what a damaged file can still change is their values.
    sizes = (len(head.shard_id), len(head.chain))
    numbers = head.epoch >= 0 and 0 <= head.seq_before <= head.seq
    return numbers and sizes == (SHARD_ID_BYTES, HASH_BYTES)


def _readable(db: sqlite3.Connection, directory: Path, mirrored: int) -> Iterator[Record]:
    # A row holds two hashes, so the files' size bounds what a damaged number can make this loop do.
    sizes = sum(path.stat().st_size for path in directory.glob(SQLITE_NAME + "*"))
    last = max(mirrored, sizes // (2 * HASH_BYTES))
    after = 0
    while after < last:
        through = min(after + BATCH_ROWS, last)
        try:
            yield from list(read_records(db, None, after, through))
        except SQLITE_ERRORS:
            yield from _one_by_one(db, after, through)
        after = through


def _one_by_one(db: sqlite3.Connection, after: int, through: int) -> Iterator[Record]:
    for seq in range(after + 1, through + 1):
        try:
            yield from list(read_records(db, None, seq - 1, seq))
        except SQLITE_ERRORS:
            # This row stands on the damaged page; the mirror has it.
            continue


def fresh(path: Path) -> Path:
    """Return `path` after removing whatever an interrupted writing left there."""
    for name in (path.name, path.name + "-wal", path.name + "-shm"):
        with translated(path):
            path.with_name(name).unlink(missing_ok=True)
    return path


def _put_in_place(new: Path, path: Path, rows: int) -> str:
    """Replace `path` by `new` in one step, keeping the old file; return the line that says so."""
    with translated(path):
        kept = ""
        if path.exists():
            number = next(
                n for n in range(1, 1 << 20) if not path.with_name(f"{path.name}.damaged-{n}").exists()
            )
            aside = path.with_name(f"{path.name}.damaged-{number}")
            os.link(path, aside)
            kept = f"; the damaged file is kept as {aside.name}"
        # SQLite would take a write-ahead log beside the new file for its own.
        for suffix in ("-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)
        new.replace(path)
        sync_directory(path.parent)
    return f"{path}: rebuilt with {rows} rows{kept}"
