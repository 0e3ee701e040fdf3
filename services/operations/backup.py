"""A copy of a data directory made beside its running services: whole, proven, and put in place at once.

Each shard is copied as of one commit: SQLite through its own backup interface, then the mirror up to the same
row. A commit is acknowledged only when it is in both, so whatever was acknowledged before the copy began is
in it. Learners come before crowds, because a crowd's conclusion is durable before a learner hears of it.
"""

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from services.operations.backup_files import copy_file, is_left_out, settle
from services.runtime.clock import Clock
from services.runtime.journal import JournalError, shard_directories, verify
from services.runtime.journal.chain import decode_group
from services.runtime.journal.erasing import is_interrupted
from services.runtime.journal.errors import translated
from services.runtime.journal.lock import is_owned, write_epoch
from services.runtime.journal.mirror import MIRROR_NAME, MirrorReader
from services.runtime.journal.store import SQLITE_NAME, open_read_only, read_head
from services.runtime.status import program_version

MANIFEST = "backup.json"
PART = ".part"


class BackupError(Exception):
    """There is no backup; the text is one line: what is wrong, where, and the mend."""


class CopiedShard(msgspec.Struct, frozen=True):
    """One shard as the copy holds it."""

    path: str
    """Below the data directory."""
    rows: int
    epoch: int
    chain: str
    """Value of the chain at the last row, hex."""


class Manifest(msgspec.Struct, frozen=True):
    """What a backup says of itself."""

    version: str
    made_at_ns: int
    shards: list[CopiedShard]
    files: list[str]


@dataclass(slots=True)
class Backup:
    """What was copied."""

    out: Path
    shards: list[CopiedShard] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    kept: int = 0
    """Shards that an interrupted backup had copied already, and that have not changed since."""
    labels: int = 0

    @property
    def rows(self) -> int:
        """How many rows all shards have together."""
        return sum(shard.rows for shard in self.shards)


def backup(data: Path, out: Path, clock: Clock) -> Backup:
    """Copy a data directory to `out`, which must not exist; services may run meanwhile.

    It is written as `OUT.part` and renamed once every shard of the copy has proven itself. An interrupted one
    is gone on with. The copy is a data directory like any other, with the same secrets in it.

    Raises: BackupError, JournalError.
    """
    if out.exists():
        raise BackupError(f"{out}: is there already: name a directory that is not")
    if out.resolve().is_relative_to(data.resolve()):
        raise BackupError(f"{out}: lies in the directory that is copied: name one outside of {data}")
    part = out.with_name(out.name + PART)
    done = Backup(out)
    with translated(part):
        directories = list(_shards(data))
        part.mkdir(mode=0o700, parents=True, exist_ok=True)
        for directory in directories:
            _take_shard(data, directory, part, done)
        for path in sorted(path for path in data.rglob("*") if path.is_file() and not path.is_symlink()):
            name = path.relative_to(data)
            if not is_left_out(name) and copy_file(path, part / name):
                done.files.append(name.as_posix())
        manifest = Manifest(program_version(), clock.wall_ns(), done.shards, done.files)
        (part / MANIFEST).write_bytes(msgspec.json.format(msgspec.json.encode(manifest), indent=2) + b"\n")
        try:
            _prove(part, done)
        except BackupError:
            shutil.rmtree(part)  # what does not hold is nothing to go on with
            raise
        settle(part)
        part.rename(out)
        settle(out.parent, deep=False)
    return done


def _shards(data: Path) -> Iterator[Path]:
    """Yield every shard below a data directory, the learner's first."""
    yield from shard_directories(data)
    for folder in sorted((*data.glob("crowd-*"), *data.glob("study-*"))):
        if any(folder.glob("shard-*")):
            yield from shard_directories(folder)


def _take_shard(data: Path, directory: Path, part: Path, done: Backup) -> None:
    name = directory.relative_to(data)
    target = part / name
    kept = _kept(directory, target, name)
    if kept is not None:
        done.kept += 1
        done.shards.append(kept)
        return
    if is_interrupted(directory):
        raise BackupError(f"{directory}: somebody is being forgotten there: back up when that has ended")
    copying = target.with_name(target.name + PART)
    for left_over in (copying, target):
        shutil.rmtree(left_over, ignore_errors=True)
    copying.mkdir(mode=0o700, parents=True)
    copied = _copy_shard(directory, copying, name)
    settle(copying)
    copying.rename(target)
    done.shards.append(copied)


def _copy_shard(directory: Path, target: Path, name: Path) -> CopiedShard:
    sqlite_path = target / SQLITE_NAME
    os.close(os.open(sqlite_path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
    with (
        closing(open_read_only(directory, live=is_owned(directory))) as source,
        closing(sqlite3.connect(sqlite_path)) as copy,
    ):
        source.backup(copy)  # in one step: it sees one commit, and writers go on
        head = read_head(copy, sqlite_path)
    _copy_mirror(directory, target / MIRROR_NAME, head.seq)
    write_epoch(target, head.epoch)
    return CopiedShard(name.as_posix(), head.seq, head.epoch, head.chain.hex())


def _copy_mirror(directory: Path, path: Path, through_seq: int) -> None:
    """Copy the mirror's bytes as they are, up to the frame that holds row `through_seq`."""
    with MirrorReader(directory) as mirror:
        end = mirror.end
        if through_seq:
            for group in mirror.groups():
                last = decode_group(group.payload)[-1].seq
                if last > through_seq:
                    break
                end = group.end
                if last == through_seq:
                    break
        copy_file(mirror.path, path, end)


def _kept(directory: Path, target: Path, name: Path) -> CopiedShard | None:
    """Return what an interrupted backup has of this shard, if nothing was written to it since."""
    if not target.exists():
        return None
    try:
        heads = []
        for each in (directory, target):
            with closing(open_read_only(each, live=is_owned(each))) as db:
                heads.append(read_head(db, each / SQLITE_NAME))
    except (JournalError, sqlite3.Error):
        return None
    ours, theirs = heads
    if (ours.shard_id, ours.seq, ours.chain) != (theirs.shard_id, theirs.seq, theirs.chain):
        return None
    return CopiedShard(name.as_posix(), theirs.seq, theirs.epoch, theirs.chain.hex())


def _prove(part: Path, done: Backup) -> None:
    """Raise BackupError unless every row of the copy is proven, and all are there."""
    roots = dict.fromkeys(part / Path(shard.path).parent for shard in done.shards)
    rows = 0
    for root in roots:
        proof = verify(root)
        if not proof.ok:
            raise BackupError(
                f"the copy does not prove itself: {proof.problems[0]}; run `sfid verify` on both"
            )
        rows += proof.rows
        done.labels += proof.labels
    if rows != done.rows:
        raise BackupError(f"{part}: holds {rows} rows of {done.rows}: check the disk and back up again")
