"""The durable journal of a learner (formats: README.md beside this file)."""

from __future__ import annotations

from services.runtime.journal.chain import Row
from services.runtime.journal.errors import (
    JournalDamaged,
    JournalDuplicate,
    JournalError,
    JournalFenced,
    JournalFull,
    JournalLocked,
    JournalNewer,
)
from services.runtime.journal.shard import Shard, shard_directory
from services.runtime.journal.shards import shard_directories
from services.runtime.journal.verify import Verification, read_rows, verify

__all__ = [
    "JournalDamaged",
    "JournalDuplicate",
    "JournalError",
    "JournalFenced",
    "JournalFull",
    "JournalLocked",
    "JournalNewer",
    "Row",
    "Shard",
    "Verification",
    "read_rows",
    "shard_directories",
    "shard_directory",
    "verify",
]
