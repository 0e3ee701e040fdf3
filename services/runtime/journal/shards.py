"""How many shards a data directory has, so that one which is gone is missed."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from services.runtime.journal.errors import JournalError, translated
from services.runtime.journal.mirror import MIRROR_NAME
from services.runtime.journal.store import SQLITE_NAME
from services.runtime.secret import written_once

COUNT_NAME = "shards"
"""File of the data directory that says how many shards its sessions are spread over; without it, one."""
SHARDS_MAX = 1_024
_BEGUN = "begun"
"""Second word of that file once every shard has its files: from then on none may be absent."""


class ShardCount(NamedTuple):
    """What a data directory says of its shards."""

    shards: int
    begun: bool


def noted_count(data_dir: Path) -> ShardCount | None:
    """Return what is noted; None where nothing is, because there is at most one shard.

    Raises: JournalError when the note cannot be read, or is gone.
    """
    path = data_dir / COUNT_NAME
    with translated(path):
        words = path.read_text("ascii", errors="replace").split() if path.exists() else None
    if words is None:
        highest = max(_numbers(data_dir), default=0)
        if highest:
            message = f"{path} is gone: write into it how many shards there are, {highest + 1} or more"
            raise JournalError(message)
        return None
    if not words or not words[0].isdecimal() or not 1 <= int(words[0]) <= SHARDS_MAX:
        message = f"{path}: not a number of shards: write the number of them that {data_dir} has"
        raise JournalError(message)
    return ShardCount(int(words[0]), words[1:] == [_BEGUN])


def note_count(data_dir: Path, shards: int) -> None:
    """Note how many shards there are to be; whoever comes second leaves what the first has noted."""
    path = data_dir / COUNT_NAME
    with translated(path):
        written_once(path, f"{shards}\n".encode())


def note_begun(data_dir: Path, shards: int) -> None:
    """Note that every shard is there."""
    path = data_dir / COUNT_NAME
    part = path.with_name(f"{COUNT_NAME}.{_BEGUN}")
    with translated(path):
        part.unlink(missing_ok=True)
        written_once(part, f"{shards} {_BEGUN}\n".encode())
        part.replace(path)


@contextmanager
def one_at_a_time(data_dir: Path) -> Iterator[None]:
    """Let one process after the other begin a data directory."""
    with translated(data_dir):
        directory = os.open(data_dir, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(directory, fcntl.LOCK_EX)
        yield
    finally:
        os.close(directory)


def holds_journal(directory: Path) -> bool:
    """Tell whether a shard's directory holds anything of a journal."""
    return any((directory / name).exists() for name in (SQLITE_NAME, MIRROR_NAME))


def shard_directories(data_dir: Path) -> list[Path]:
    """Return the deployment's shards in order.

    Raises: JournalError when there is none, or one of those that were begun is gone.
    """
    numbers = _numbers(data_dir)
    noted = noted_count(data_dir)
    if noted is not None and noted.begun:
        for number in range(noted.shards):
            if not holds_journal(data_dir / f"shard-{number}"):
                raise gone(data_dir, number)
    if not numbers:
        message = f"{data_dir}: holds no journal; name the data directory of a learner"
        raise JournalError(message)
    return [data_dir / f"shard-{number}" for number in numbers]


def gone(data_dir: Path, shard: int) -> JournalError:
    """Return the error of a shard that was there and is not."""
    path = data_dir / f"shard-{shard}"
    return JournalError(f"{path}: this shard is gone: mount its disk, or restore it from a backup")


def _numbers(data_dir: Path) -> list[int]:
    with translated(data_dir):
        return sorted(
            int(path.name.removeprefix("shard-"))
            for path in data_dir.iterdir()
            if path.name.startswith("shard-") and path.name.removeprefix("shard-").isdecimal()
        )
