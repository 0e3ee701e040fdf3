"""The mirror of a shard: an append-only log of framed groups, synced beside the commit of SQLite.

The first frame holds the format's name and the shard's id; every later frame holds one commit's rows.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from protocol.framing import HEADER_BYTES, Frame, frame, frames
from services.runtime.journal.errors import JournalError, translated
from services.runtime.journal.syncer import Syncer

MIRROR_NAME = "journal.mirror"
SHARD_ID_BYTES = 16
_TITLE = b"sfid mirror 1\0"
TITLE_FRAME_BYTES = HEADER_BYTES + len(_TITLE) + SHARD_ID_BYTES
# A rebuilt mirror has no commits to follow: groups of about this size keep one frame's damage small.
_REBUILT_GROUP_BYTES = 64 * 1024


class Mirror:
    """The writer's end of the log. Its methods raise JournalFull or JournalError.

    Attributes:
        end: the offset after the last frame that counts.
        in_doubt: whether a sync was begun and has not succeeded: what stands behind `end` is then unknown.
        syncer_type: who syncs it, beside the thread that asks.
    """

    syncer_type: type[Syncer] = Syncer

    def __init__(self, directory: Path, end: int) -> None:
        """Open the existing log in `directory`, whose last whole frame ends at `end`."""
        self.path = directory / MIRROR_NAME
        self.end = end
        self.in_doubt = False
        self._written = end
        with translated(self.path):
            self._fd = os.open(self.path, os.O_WRONLY | os.O_CLOEXEC)
        self._syncer = self.syncer_type(self._fd)

    def write(self, group: bytes) -> None:
        """Write one frame around `group` behind `end`, not yet synced."""
        data = frame(group)
        # Before the writing, because a write that fails may have left some bytes.
        self._written = self.end + len(data)
        with translated(self.path):
            write_at(self._fd, data, self.end)

    def start_sync(self) -> None:
        """Have the written frame synced by another thread; `wait_synced` comes before anything else."""
        self.in_doubt = True
        self._syncer.start()

    def wait_synced(self) -> None:
        """Return when the frame is synced; it is part of the log only after `settle`."""
        with translated(self.path):
            self._syncer.wait()
        self.in_doubt = False

    def settle(self) -> None:
        """Take the written frame as part of the log."""
        self.end = self._written

    def drop_written(self) -> None:
        """Take a frame that was written and not settled out of the file: a full disk gets its bytes back."""
        if self._written != self.end:
            self.cut()
            self._written = self.end

    def cut(self) -> None:
        """Drop whatever stands behind `end`."""
        with translated(self.path):
            os.ftruncate(self._fd, self.end)

    def close(self) -> None:
        """Close the file."""
        # A number closed twice could be somebody else's file by then.
        fd, self._fd = self._fd, -1
        self._syncer.close()
        # An error here says nothing new: what mattered was synced before, or reported then.
        if fd >= 0:
            with suppress(OSError):
                os.close(fd)


class MirrorReader:
    """The log read from its start; a context manager.

    Attributes:
        shard_id: the shard the log belongs to.
        end: the offset after the last frame read.
    """

    def __init__(self, directory: Path) -> None:
        """Open the log in `directory`; JournalError when it is missing or its first frame is not whole."""
        self.path = directory / MIRROR_NAME
        if not self.path.exists():
            message = f"{self.path}: the file is missing; opening the shard rebuilds it from SQLite"
            raise JournalError(message)
        with translated(self.path):
            self._file = self.path.open("rb", buffering=1 << 20)
            title = next(frames(self._file), None)
        if title is None or not title.payload.startswith(_TITLE) or title.end != TITLE_FRAME_BYTES:
            self._file.close()
            message = f"{self.path}: its first frame is damaged; opening the shard rebuilds it from SQLite"
            raise JournalError(message)
        self.shard_id = title.payload[len(_TITLE) :]
        self.end = title.end

    def groups(self) -> Iterator[Frame]:
        """Yield the frames of rows in order up to the first byte that begins no whole frame."""
        self._file.seek(self.end)
        with translated(self.path):
            for one in frames(self._file, self.end):
                self.end = one.end
                yield one

    def rest(self) -> bytes:
        """Return every byte from `end` on."""
        with translated(self.path):
            self._file.seek(self.end)
            return self._file.read()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


def create_mirror(path: Path, shard_id: bytes, encoded: Iterable[bytes]) -> None:
    """Write a new log at `path` (which must not exist) that holds the `encoded` rows, durable on return."""
    with translated(path):
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        try:
            at = write_at(fd, frame(_TITLE + shard_id), 0)
            group: list[bytes] = []
            waiting = 0
            for row in encoded:
                group.append(row)
                waiting += len(row)
                if waiting >= _REBUILT_GROUP_BYTES:
                    at = write_at(fd, frame(b"".join(group)), at)
                    group, waiting = [], 0
            if group:
                write_at(fd, frame(b"".join(group)), at)
            os.fsync(fd)
        finally:
            os.close(fd)


def write_at(fd: int, data: bytes, at: int) -> int:
    """Write `data` at offset `at`, through short writes; return the offset after it, or raise OSError."""
    view = memoryview(data)
    while view:
        written = os.pwrite(fd, view, at)
        at += written
        view = view[written:]
    return at


def sync_directory(directory: Path) -> None:
    """Make the names in `directory` durable; raises OSError."""
    fd = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
