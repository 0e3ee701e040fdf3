"""Which shard of a data directory a session belongs to, and of how many shards there are."""

from hashlib import sha256
from pathlib import Path

from services.runtime.journal.errors import JournalError, translated
from services.runtime.journal.shard import Shard, shard_directory
from services.runtime.journal.shards import (
    holds_journal,
    note_begun,
    note_count,
    noted_count,
    one_at_a_time,
    shard_directories,
)

BRANCH = "-from"
"""What a branch's name has behind that of its origin: both lie in one shard, whose journal is copied."""


def shard_of(session: str, shards: int) -> int:
    """Return the shard, from 0, of a session where there are so many, by its name before `-from`."""
    # Names differ by a number mostly; a checksum would put lesson1 to lesson7 into one shard of three.
    digest = sha256(session.partition(BRANCH)[0].encode()).digest()
    return int.from_bytes(digest[:8], "big") % shards


def agree_on_shards(data_dir: Path, shards: int) -> None:
    """Hold a data directory to the number of shards that it was begun with; the first to come says it.

    Another number would look for sessions where they are not. Raises: JournalError, also when one of several
    shards is gone.
    """
    with translated(data_dir):
        data_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
        begun = any(data_dir.glob("shard-*"))
    noted = noted_count(data_dir)
    if noted is None and shards > 1 and not begun:
        note_count(data_dir, shards)
        noted = noted_count(data_dir)
    agreed = 1 if noted is None else noted.shards
    if agreed != shards:
        message = f"{data_dir}: its sessions lie in {agreed} shards, not in {shards}: pass --shards {agreed}"
        raise JournalError(message)
    if noted is not None and noted.begun:
        shard_directories(data_dir)
    elif noted is not None:
        _begin(data_dir, shards)


def _begin(data_dir: Path, shards: int) -> None:
    """Give every shard its files, so that from now on an absent one is a loss."""
    with one_at_a_time(data_dir):
        for shard in range(shards):
            if not holds_journal(shard_directory(data_dir, shard)):
                Shard.open(data_dir, shard).close()
        note_begun(data_dir, shards)
