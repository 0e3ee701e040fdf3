"""Which shard of a data directory a session belongs to, and of how many shards there are."""

from hashlib import sha256
from pathlib import Path

from services.runtime.journal.errors import JournalError, translated
from services.runtime.secret import written_once

BRANCH = "-from"
"""What a branch's name has behind that of its origin: both lie in one shard, whose journal is copied."""
COUNT_NAME = "shards"
"""File of the data directory that says how many shards its sessions are spread over; without it, one."""
SHARDS_MAX = 1_024


def shard_of(session: str, shards: int) -> int:
    """Return the shard, from 0, of a session where there are so many, by its name before `-from`."""
    # Names differ by a number mostly; a checksum would put lesson1 to lesson7 into one shard of three.
    digest = sha256(session.partition(BRANCH)[0].encode()).digest()
    return int.from_bytes(digest[:8], "big") % shards


def agree_on_shards(data_dir: Path, shards: int) -> None:
    """Hold a data directory to the number of shards that it was begun with; the first to come says it.

    Another number would look for sessions where they are not. Raises: JournalError.
    """
    path = data_dir / COUNT_NAME
    with translated(data_dir):
        data_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
        begun = any(data_dir.glob("shard-*"))
    if shards > 1 and not (begun and not path.exists()):
        with translated(path):
            written_once(path, f"{shards}\n".encode())
    agreed = _agreed(path)
    if agreed != shards:
        message = f"{data_dir}: its sessions lie in {agreed} shards, not in {shards}: pass --shards {agreed}"
        raise JournalError(message)


def _agreed(path: Path) -> int:
    try:
        with translated(path):
            text = path.read_bytes() if path.exists() else b"1"
        agreed = int(text)
    except ValueError:
        agreed = 0
    if not 1 <= agreed <= SHARDS_MAX:
        message = f"{path}: not a number of shards: write the number of them that {path.parent} has"
        raise JournalError(message)
    return agreed
