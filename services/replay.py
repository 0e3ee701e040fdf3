"""Rebuilding sessions and crowds from their journals, without any service."""

from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path

from protocol.crowd_journal import FoldedCrowd, fold_crowd
from protocol.journal import Kind, Record, fold
from services.runtime.journal import read_rows
from sfid_core.crowd.tally import Reliability


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
    erased: int = 0
    """Answers erased, or corrected because of one that was."""


def replay_directory(data_dir: Path, session: str | None = None) -> list[Replayed]:
    """Return every session (or the one named) of a data directory, by name.

    Raises: JournalError, or DecodeError when a row cannot be read.
    """
    erased: Counter[str] = Counter()
    records = _by_session(data_dir, session, erased)
    found = (_replayed(name, records[name], erased[name]) for name in sorted(records))
    return [replayed for replayed in found if replayed is not None]


def _by_session(
    data_dir: Path, session: str | None, erased: Counter[str] | None = None
) -> dict[str, list[Record]]:
    records: dict[str, list[Record]] = defaultdict(list)
    for row in read_rows(data_dir, session):
        if erased is not None and row.kind == Kind.ANSWER.value:
            erased[row.session] += row.body is None or row.amended
        if row.body is not None:
            records[row.session].append(Record(row.kind, row.at_ns, row.body))
    return records


@dataclass(frozen=True, slots=True)
class ReplayedCrowd:
    """What the journal of a session's crowd builds."""

    session: str
    aggregator: str
    conclusions: int
    """Rounds that reliabilities were learnt from."""
    matches: bool
    """Whether every conclusion that was handed on, and every noted reliability, came out again to the bit."""
    reliabilities: dict[str, Reliability]
    """By worker; of the kind of answer that was asked for last."""


def replay_crowds(data_dir: Path, session: str | None = None) -> list[ReplayedCrowd]:
    """Return every crowd (or that of the session named) beside a learner's journal, by aggregator.

    Raises: JournalError, or DecodeError when a row cannot be read.
    """
    replayed: list[ReplayedCrowd] = []
    for directory in sorted(data_dir.glob("crowd-*")):
        for name, records in sorted(_by_session(directory, session).items()):
            folded = fold_crowd(records)
            if folded is not None:
                replayed.append(_replayed_crowd(name, folded))
    return replayed


def _replayed_crowd(session: str, folded: FoldedCrowd) -> ReplayedCrowd:
    aggregates = list(folded.crowd.aggregates.values())[-1:]
    known = {worker: one.reliability(worker) for one in aggregates for worker in one.workers()}
    crowd, config = folded.crowd, folded.config
    return ReplayedCrowd(session, config.aggregator, crowd.conclusions, not folded.mismatches, known)


def _replayed(name: str, records: list[Record], erased: int) -> Replayed | None:
    folded = fold(records)
    if folded is None:
        return None
    episodes = len(folded.session.episodes)
    digest = folded.session.learner.sha256()
    return Replayed(name, digest, not folded.mismatches, folded.digests, folded.events, episodes, erased)
