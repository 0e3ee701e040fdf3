"""A disk that fails and loses power: the real journal on real files, with a fate drawn for every commit.

What a power cut leaves behind is put together at the moment of the cut from what the commit had made durable
in either file, and the next life opens that; nothing the dying process does afterwards can mend it.
"""

import os
import shutil
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from random import Random

from protocol.framing import frame
from services.runtime.journal.errors import JournalError, JournalFull
from services.runtime.journal.lock import EPOCH_NAME, ShardLock
from services.runtime.journal.mirror import MIRROR_NAME, Mirror
from services.runtime.journal.shard import Shard, shard_directory
from services.runtime.journal.store import SQLITE_NAME
from services.runtime.journal.syncer import Syncer
from services.runtime.timeline import Timeline

DATABASE = (SQLITE_NAME, f"{SQLITE_NAME}-wal")
KEPT = (*DATABASE, MIRROR_NAME, EPOCH_NAME)
FULL_NS_MAX = 2_000_000_000


class PowerCut(BaseException):
    """The process dies here: not an Exception, so that nobody in it survives by catching it."""


class Fate(Enum):
    """What becomes of one commit."""

    GOOD = "good"
    FULL = "no space left"
    SYNC_FAILS = "the sync fails after everything was written"
    CUT_BEFORE = "power cut before anything was written"
    CUT_TORN = "power cut in the middle of the mirror's frame"
    CUT_MIRROR_FIRST = "power cut when the mirror was synced and the database not"
    CUT_DATABASE_FIRST = "power cut when the database was synced and the mirror not, or in part"
    CUT_AFTER = "power cut after the commit, before any acknowledgement"


_FAILURES = (Fate.FULL, Fate.SYNC_FAILS)
_CUTS = tuple(fate for fate in Fate if fate.name.startswith("CUT_"))


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


class _SameThread(Syncer):
    """Syncs in the thread that asks: simulated time has one thread."""

    def __init__(self, fd: int) -> None:  # the thread of the other is what is left out
        self._fd = fd

    def start(self) -> None:
        os.fdatasync(self._fd)

    def wait(self) -> None:
        """It is done already."""

    def close(self) -> None:
        """There is nothing to end."""


class SimulatedMirror(Mirror):
    """The mirror without a thread of its own."""

    syncer_type = _SameThread


class SimulatedShard(Shard):
    """The journal as it is, on a disk of the simulation."""

    mirror_type = SimulatedMirror

    def __init__(self, directory: Path, lock: ShardLock, disk: Disk) -> None:
        super().__init__(directory, lock)
        self._disk = disk

    def commit(self) -> None:
        """See Shard."""
        if not self._group.records:
            super().commit()
            return
        match self._disk.draw():
            case Fate.GOOD:
                super().commit()
            case Fate.FULL:
                raise JournalFull("the disk: no space left")
            case Fate.SYNC_FAILS:
                self._leave_unsynced()
                raise JournalError("the disk: input/output error")
            case Fate.CUT_BEFORE:
                self._disk.cut()
                raise PowerCut
            case Fate.CUT_AFTER:
                super().commit()
                self._disk.cut()
                raise PowerCut
            case Fate.CUT_TORN | Fate.CUT_MIRROR_FIRST | Fate.CUT_DATABASE_FIRST:
                self._die_between()

    def abandon(self) -> None:
        """Let go of everything as the death of the process does: nothing more is written."""
        self._store.close()
        self._mirror.close()
        self._lock.release()

    def _leave_unsynced(self) -> None:
        """Leave the group in the mirror as a failed sync does: it may be there, and may not be trusted."""
        with (self.directory / MIRROR_NAME).open("r+b") as file:
            file.seek(self._mirror.end)
            file.write(frame(b"".join(self._group.encoded)))
        self._suspect = True

    def _die_between(self) -> None:
        """Commit, and let the next life find one of the two files as it was before, or in part."""
        directory, mirror = self.directory, self.directory / MIRROR_NAME
        before = {name: (directory / name).read_bytes() for name in DATABASE if (directory / name).exists()}
        begin = min(mirror.stat().st_size, self._mirror.end)  # behind it stands what failed before
        super().commit()
        end = mirror.stat().st_size
        self._disk.cut()
        after = shard_directory(self._disk.data_dir, 0)
        if self._disk.fate is not Fate.CUT_DATABASE_FIRST:
            for name in DATABASE:
                (after / name).unlink(missing_ok=True)
            for name, content in before.items():
                (after / name).write_bytes(content)
        if self._disk.fate is not Fate.CUT_MIRROR_FIRST:
            with (after / MIRROR_NAME).open("r+b") as file:
                file.truncate(begin + self._disk.torn(end - begin))
        raise PowerCut
