"""Files of a backup beside the journals: which, and durably."""

import os
import re
import shutil
from pathlib import Path
from typing import BinaryIO

_LEFT_OUT = re.compile(
    r"""
    (^|/)(logs|recordings|kernels-[^/]*|shard-[0-9]+(\.part)?)/   # made again, or copied by themselves
    | \.(rrd|part|sock|log)$ | \.damaged- | (^|/)((processes|deployment)\.json|lock|outbox[^/]*)$
    """,
    re.VERBOSE,
)
_CHUNK_BYTES = 1 << 20


def is_left_out(name: Path) -> bool:
    """Tell whether a file, by its path below the data directory, is no part of a backup.

    Recordings can be made from the journal again; logs, lists of processes and the router's address belong to
    the machine; what a teacher has not sent yet is the teacher's own.
    """
    return _LEFT_OUT.search(name.as_posix()) is not None


def copy_file(path: Path, target: Path, size: int | None = None) -> bool:
    """Copy a file, or its first `size` bytes, with its mode; tell whether it was still there.

    Raises: OSError.
    """
    try:
        source = path.open("rb")
    except FileNotFoundError:
        return False
    with source:
        target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        mode = os.fstat(source.fileno()).st_mode & 0o777
        handle = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode)
        with os.fdopen(handle, "wb") as copy:
            if size is None:
                shutil.copyfileobj(source, copy, _CHUNK_BYTES)
            else:
                _copy_bytes(source, copy, size)
    return True


def _copy_bytes(source: BinaryIO, copy: BinaryIO, size: int) -> None:
    while size > 0:
        chunk = source.read(min(size, _CHUNK_BYTES))
        if not chunk:
            return
        copy.write(chunk)
        size -= len(chunk)


def settle(folder: Path, *, deep: bool = True) -> None:
    """Make files and names below a folder (or its names alone) durable. Raises: OSError."""
    if deep:
        for path in sorted(folder.rglob("*")):
            _sync(path)
    _sync(folder)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
