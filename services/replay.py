"""Rebuilding sessions from a journal, without any service."""

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

from protocol.journal import Record, fold
from services.runtime.journal import read_rows


@dataclass(frozen=True, slots=True)
class Replayed:
    """What a session's journal builds."""

    session: str
    q_sha256: str
    matches: bool
    """Whether every noted digest, and everything that teachers were told, came out again."""
    digests: int
    """Digests noted: at episodes 1, 2, 4, 8 and so on, and at the end."""
    events: int
    episodes: int


def replay_directory(data_dir: Path, session: str | None = None) -> list[Replayed]:
    """Return every session (or the one named) of a data directory, by name.

    Raises: JournalError, or DecodeError when a row cannot be read.
    """
    records: dict[str, list[Record]] = defaultdict(list)
    for row in read_rows(data_dir, session):
        if row.body is not None:
            records[row.session].append(Record(row.kind, row.at_ns, row.body))
    return [replayed for name in sorted(records) if (replayed := _replayed(name, records[name])) is not None]


def _replayed(name: str, records: list[Record]) -> Replayed | None:
    folded = fold(records)
    if folded is None:
        return None
    episodes = len(folded.session.episodes)
    digest = folded.session.learner.sha256()
    return Replayed(name, digest, not folded.mismatches, folded.digests, folded.events, episodes)
