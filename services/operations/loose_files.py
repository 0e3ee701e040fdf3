"""Files beside the journals that speak of a person: recordings, logs, and whatever else names them."""

import os
import re
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from services.runtime.journal import JournalError
from services.runtime.register import NAME as REGISTER

PEOPLE = "people.json"
NAMELESS = b"erased"
_TABLES = frozenset({".csv", ".parquet", ".hdf5", ".lurd", ".tsv", ".jsonl"})
"""Of exports that name a person, each is made again from the journal by its command."""
_CLOSED = frozenset({".parquet", ".hdf5", ".gz", ".zip"})
"""Compressed: whether they name somebody cannot be seen, so they are taken to."""


@dataclass(slots=True)
class Loose:
    """What was found beside the journals."""

    recordings: list[Path] = field(default_factory=list)
    """Recordings of sessions in which the person taught; exports that name them or cannot be looked into."""
    removed: bool = False
    """Whether they are gone: all of them can be made again from the journal."""
    rewritten: list[Path] = field(default_factory=list)
    """Logs and lists of people (of a study, of who took up an invitation) that no longer name the person."""
    left: list[Path] = field(default_factory=list)
    """Files that still name the person: not this command's to change."""


def loose_files(
    data: Path,
    person: str,
    sessions: Collection[str],
    *,
    everywhere: bool,
    dry_run: bool,
    recordings: bool,
) -> Loose:
    """Take a person out of the files beside the journals, or with a dry run tell which those are.

    Raises: JournalError when a file cannot be read or written.
    """
    found = Loose(removed=recordings and not dry_run)
    named = re.compile(rb"(?<![a-z0-9_])" + re.escape(person.encode()) + rb"(?![a-z0-9_])")
    try:
        for path in sorted(path for path in data.rglob("*") if path.is_file()):
            if path.suffix == ".rrd":
                if any(path.name == f"{one}.rrd" or _is_later(path.name, one) for one in sessions):
                    found.recordings.append(path)
                    if found.removed:
                        path.unlink()
            elif everywhere and _is_export(path, named):
                found.recordings.append(path)
                if found.removed:
                    path.unlink()
            elif everywhere and not path.parent.name.startswith("shard-"):
                _other(path, person, named, found, dry_run=dry_run)
    except OSError as error:
        message = f"{error.filename}: {error.strerror}; mend it and say it again"
        raise JournalError(message) from error
    return found


def _is_export(path: Path, named: re.Pattern[bytes]) -> bool:
    if path.name == REGISTER or path.suffix not in _TABLES | _CLOSED:
        return False
    return path.suffix in _CLOSED or named.search(path.name.encode() + b"\n" + path.read_bytes()) is not None


def _is_later(name: str, session: str) -> bool:
    return re.fullmatch(re.escape(session) + r"\.[0-9]+\.rrd", name) is not None


def _other(path: Path, person: str, named: re.Pattern[bytes], found: Loose, *, dry_run: bool) -> None:
    if named.search(path.name.encode()):
        found.left.append(path)
        return
    before = path.read_bytes()
    if not named.search(before):
        return
    if path.name == PEOPLE:
        known = msgspec.json.decode(before, type=dict[str, object])
        known.pop(person, None)
        after = msgspec.json.encode(known)
    elif path.name == REGISTER:
        after = b"".join(line for line in before.splitlines(keepends=True) if not named.search(line))
    elif path.suffix == ".log":
        after = named.sub(NAMELESS, before)
    else:
        found.left.append(path)
        return
    found.rewritten.append(path)
    if not dry_run:
        _replace(path, after)


def _replace(path: Path, content: bytes) -> None:
    part = path.with_name(path.name + ".part")
    handle = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(handle, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)
