"""Who owns a shard: an exclusive lock while a process lives, and an epoch that outlives it."""

from __future__ import annotations

import fcntl
import os
import time
from contextlib import suppress
from pathlib import Path

from services.runtime.journal.errors import JournalError, JournalFenced, JournalLocked, translated
from services.runtime.journal.mirror import sync_directory

LOCK_NAME = "lock"
EPOCH_NAME = "epoch"
# A check for an owner takes a shared lock for microseconds; looking again tells it from an owner.
_LOOKS = 3
_BETWEEN_LOOKS_S = 0.002


class ShardLock:
    """The exclusive lock on a shard, held from construction to `release`."""

    def __init__(self, directory: Path) -> None:
        """Take the lock without waiting; JournalLocked when another process has it."""
        self.path = directory / LOCK_NAME
        with translated(self.path):
            self._fd = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            with translated(self.path):
                self._take(directory)
                os.ftruncate(self._fd, 0)
                os.pwrite(self._fd, f"{os.getpid()}\n".encode(), 0)
                mine = os.fstat(self._fd)
        except BaseException:
            os.close(self._fd)
            raise
        self._mine = (mine.st_dev, mine.st_ino)

    def _take(self, directory: Path) -> None:
        for look in range(_LOOKS):
            try:
                fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if look + 1 < _LOOKS:
                    time.sleep(_BETWEEN_LOOKS_S)
            else:
                return
        pid = os.pread(self._fd, 32, 0).decode(errors="replace").strip()
        owner = f"process {pid}" if pid.isdigit() else "another process"
        message = f"{directory}: {owner} already writes this journal; stop it or name another data directory"
        raise JournalLocked(message)

    def check(self) -> None:
        """Raise JournalFenced when the lock file is no longer the one this process holds."""
        try:
            seen = self.path.stat()
        except OSError:
            seen = None
        if seen is None or (seen.st_dev, seen.st_ino) != self._mine:
            message = f"{self.path}: the lock was taken away from this process; stop it and start one learner"
            raise JournalFenced(message)

    def release(self) -> None:
        """Give the lock back; the file stays, because unlinking it would let two owners in."""
        # A number closed twice could be somebody else's file by then.
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with suppress(OSError):
                os.close(fd)


def is_owned(directory: Path) -> bool:
    """Tell whether a process holds the shard's lock at this moment."""
    try:
        fd = os.open(directory / LOCK_NAME, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(fd)
    return False


def read_epoch(directory: Path) -> int | None:
    """Return the epoch in the epoch file, None when there is none; JournalError when it is damaged."""
    path = directory / EPOCH_NAME
    try:
        with translated(path):
            text = path.read_bytes()
    except JournalError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            return None
        raise
    digits = text.removesuffix(b"\n")
    if not digits.isdigit() or len(digits) > 18:  # more digits than int64 holds
        message = f"{path}: not a number; opening the shard writes it anew"
        raise JournalError(message)
    return int(digits)


def write_epoch(directory: Path, epoch: int) -> None:
    """Replace the epoch file, durable on return."""
    path = directory / EPOCH_NAME
    new = path.with_name(EPOCH_NAME + ".new")
    with translated(path):
        fd = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        try:
            os.write(fd, f"{epoch}\n".encode())
            os.fsync(fd)
        finally:
            os.close(fd)
        new.replace(path)
        sync_directory(directory)
