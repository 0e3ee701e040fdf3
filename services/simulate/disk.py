"""A disk that fails and loses power: the real journal on real files, with a fate drawn for every commit.

What a power cut leaves behind is copied at the very moment of the cut, so that nothing the dying process does
afterwards can mend it; the next life opens the copy.
"""

import errno
import os
import shutil
import sqlite3
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from random import Random

from protocol.framing import frame
from services.runtime.journal.errors import JournalError, translated
from services.runtime.journal.lock import EPOCH_NAME, ShardLock
from services.runtime.journal.mirror import MIRROR_NAME, Mirror
from services.runtime.journal.shard import Shard, shard_directory
from services.runtime.journal.store import SQLITE_NAME, Store
from services.runtime.timeline import Timeline

KEPT = (SQLITE_NAME, f"{SQLITE_NAME}-wal", MIRROR_NAME, EPOCH_NAME)
FULL_NS_MAX = 2_000_000_000


class PowerCut(BaseException):
    """The process dies here: not an Exception, so that nobody in it survives by catching it."""


class Fate(Enum):
    """What becomes of one commit."""

    GOOD = "good"
    FULL = "no space left"
    SYNC_FAILS = "the sync of the mirror fails"
    COMMIT_FAILS = "the commit of the database fails"
    CUT_BEFORE = "power cut before anything was written"
    CUT_TORN = "power cut in the middle of the mirror's frame"
    CUT_BETWEEN = "power cut between mirror and database"
    CUT_AFTER = "power cut after the commit, before any acknowledgement"


_FAILURES = (Fate.FULL, Fate.SYNC_FAILS, Fate.COMMIT_FAILS)
_CUTS = (Fate.CUT_BEFORE, Fate.CUT_TORN, Fate.CUT_BETWEEN, Fate.CUT_AFTER)


@dataclass(frozen=True, slots=True)
class DiskFaults:
    """Probabilities of a commit."""

    fails: float = 0.0
    cut: float = 0.0


class Disk:
    """Where a learner's lives keep their files; life n + 1 begins with what life n had made durable."""

    def __init__(self, root: Path, timeline: Timeline, chance: Random, faults: DiskFaults) -> None:
        self.faults = faults
        self.life = 0
        self.fate = Fate.GOOD
        self.fates: list[Fate] = []
        """What happened other than good."""
        self._root, self._timeline, self._chance = root, timeline, chance
        self._full_until_ns = 0
        self._imaged = False

    @property
    def data_dir(self) -> Path:
        """The data directory of the present life."""
        return self._root / f"life-{self.life}"

    def open(self) -> "SimulatedShard":
        """Begin a life: open the journal on what the last one left."""
        self._imaged = False
        directory = shard_directory(self.data_dir, 0)
        directory.mkdir(parents=True, exist_ok=True)
        lock = ShardLock(directory)
        try:
            return SimulatedShard(directory, lock, self)
        except BaseException:
            lock.release()
            raise

    def cut(self) -> None:
        """Keep what is durable now as the beginning of the next life; the first cut of a life counts."""
        if self._imaged:
            return
        self._imaged = True
        before = shard_directory(self.data_dir, 0)
        self.life += 1
        after = shard_directory(self.data_dir, 0)
        after.mkdir(parents=True)
        for name in KEPT:
            if (before / name).exists():
                shutil.copyfile(before / name, after / name)

    def draw(self) -> Fate:
        """Draw what becomes of the commit that begins."""
        self.fate = self._drawn()
        if self.fate is not Fate.GOOD:
            self.fates.append(self.fate)
        return self.fate

    def _drawn(self) -> Fate:
        now_ns = self._timeline.now_ns()
        if now_ns < self._full_until_ns:
            return Fate.FULL
        drawn = self._chance.random()
        if drawn < self.faults.cut:
            return self._chance.choice(_CUTS)
        if drawn < self.faults.cut + self.faults.fails:
            fate = self._chance.choice(_FAILURES)
            if fate is Fate.FULL:
                self._full_until_ns = now_ns + int(self._chance.random() * FULL_NS_MAX)
            return fate
        return Fate.GOOD

    def torn(self, size: int) -> int:
        """Draw how many of `size` unsynced bytes reached the disk."""
        return self._chance.randrange(size)


class SimulatedShard(Shard):
    """The journal as it is, its two files on a disk of the simulation."""

    def __init__(self, directory: Path, lock: ShardLock, disk: Disk) -> None:
        super().__init__(directory, lock)
        self._disk = disk
        self._put_on_disk()

    def abandon(self) -> None:
        """Let go of everything as the death of the process does: nothing more is written."""
        self._store.close()
        self._mirror.close()
        self._lock.release()

    def _reopen(self) -> None:
        super()._reopen()
        self._put_on_disk()

    def _put_on_disk(self) -> None:
        store, mirror = self._store, self._mirror
        self._store = SimulatedStore(self.directory, self._disk)
        self._mirror = SimulatedMirror(self.directory, mirror.end, self._disk)
        store.close()
        mirror.close()


class SimulatedMirror(Mirror):
    """The mirror; a commit begins with it, so the fate is drawn here."""

    def __init__(self, directory: Path, end: int, disk: Disk) -> None:
        super().__init__(directory, end)
        self._disk = disk

    def append(self, group: bytes) -> int:
        """See Mirror."""
        fate = self._disk.draw()
        if fate is Fate.FULL:
            with translated(self.path):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if fate is Fate.CUT_BEFORE:
            self._die()
        if fate is Fate.CUT_TORN:
            data = frame(group)
            self._write(data[: self._disk.torn(len(data))])
            self._die()
        if fate is Fate.SYNC_FAILS:
            self._write(frame(group))
            with translated(self.path):
                raise OSError(errno.EIO, os.strerror(errno.EIO))
        end = super().append(group)
        if fate is Fate.CUT_BETWEEN:
            self._die()
        return end

    def _write(self, data: bytes) -> None:
        with self.path.open("r+b") as file:
            file.seek(self.end)
            file.write(data)

    def _die(self) -> None:
        self._disk.cut()
        raise PowerCut


class SimulatedStore(Store):
    """The database; its commit is the last thing that can go wrong."""

    def __init__(self, directory: Path, disk: Disk) -> None:
        super().__init__(directory)
        self._disk = disk

    def commit(self) -> None:
        """See Store."""
        if self._disk.fate is Fate.COMMIT_FAILS:
            with translated(self.path):
                raise sqlite3.OperationalError("disk I/O error")
        super().commit()
        if self._disk.fate is Fate.CUT_AFTER:
            self._disk.cut()
            raise PowerCut


__all__ = ["Disk", "DiskFaults", "Fate", "JournalError", "PowerCut", "SimulatedShard"]
