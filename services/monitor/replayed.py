"""A session's recording made from the journal alone: the same rows as the one that was made live."""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import merge
from pathlib import Path

from protocol.crowd_message import Crowd
from protocol.journal import Record
from protocol.messages import Decision, Episode, Step
from protocol.retelling import Retelling, retold_crowd
from services.monitor.chronicle import Chronicle
from services.monitor.config import MonitorError
from services.monitor.recordings import Recording
from services.runtime.journal import read_rows

ROWS_A_WRITE = 256

Message = Decision | Step | Episode | Crowd


@dataclass(frozen=True, slots=True)
class Rerecorded:
    """What was written."""

    session: str
    path: Path
    steps: int
    episodes: int
    unreadable_views: int


def record_again(data_dir: Path, session: str, deployment: str, path: Path) -> Rerecorded:
    """Write the recording of a journaled session, over a file of that name.

    Raises: MonitorError when the file cannot be written; JournalError or DecodeError when the journal cannot
    be read.
    """
    try:
        path.write_bytes(b"")
    except OSError as error:
        reason = error.strerror or str(error)
        raise MonitorError(
            f"cannot write {path}: {reason}; give a file in a folder you may write to"
        ) from None
    chronicle = Chronicle()
    recording = Recording(path, session, f"{deployment}-{session}")
    steps = episodes = 0
    for number, message in enumerate(messages_of(data_dir, session)):
        chronicle.tell(message)
        steps += isinstance(message, Step)
        episodes += isinstance(message, Episode)
        if number % ROWS_A_WRITE == 0:
            recording.write(chronicle.take())
    recording.write(chronicle.take())
    if not recording.close():
        raise MonitorError(f"cannot write {path} to its end: make room and say it again")
    return Rerecorded(session, path, steps, episodes, chronicle.unreadable_views)


def messages_of(data_dir: Path, session: str) -> Iterator[Message]:
    """Yield what was published about a session, learner and aggregators merged by time."""
    told: list[Iterator[tuple[int, Message]]] = [_of_the_learner(data_dir, session)]
    told += [_of_a_crowd(folder, session) for folder in sorted(data_dir.glob("crowd-*"))]
    for _, message in merge(*told, key=lambda each: each[0]):
        yield message


def _records(data_dir: Path, session: str) -> Iterator[Record]:
    for row in read_rows(data_dir, session):
        if row.body is not None:
            yield Record(row.kind, row.at_ns, row.body)


def _of_the_learner(data_dir: Path, session: str) -> Iterator[tuple[int, Message]]:
    retelling = Retelling()
    for record in _records(data_dir, session):
        yield from retelling.tell(record)


def _of_a_crowd(folder: Path, session: str) -> Iterator[tuple[int, Message]]:
    for crowd in retold_crowd(_records(folder, session), session):
        yield crowd.at_ns, crowd
