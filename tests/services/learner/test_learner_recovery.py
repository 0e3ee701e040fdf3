"""A session rebuilt while its journal is proven is the session that the journal tells."""

import shutil
from pathlib import Path

import pytest

from protocol.journal import Folded, Kind, event_body, fold
from services.learner.recovery import Recovery
from services.runtime.journal import JournalError, Shard
from services.runtime.journal.beside import BESIDE_BYTES
from services.runtime.journal.store import SQLITE_NAME
from sfid_core.session.events import Paused, TeacherJoined
from tests.services.faults.long_journal import SESSION, write_lesson

PADS = 9
LABELS = 60


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A lesson in a file so large that it is read ahead: what is no event fills it."""
    write_lesson(tmp_path / "data", LABELS)
    with Shard.open(tmp_path / "data") as shard:
        for _ in range(PADS):
            shard.append(SESSION, Kind.CONFLICT.value, bytes(BESIDE_BYTES // 8), at_ns=0)
    return tmp_path / "data"


def told(folded: Folded | None) -> tuple[object, ...]:
    assert folded is not None
    session = folded.session
    return (
        session.learner.sha256(), session.decision, session.episode, session.phase, session.paused,
        session.teachers, session.counts, folded.actions_taken, folded.known, folded.events,
        folded.digests, folded.mismatches,
    )  # fmt: skip


def test_a_session_rebuilt_during_the_proof_is_the_one_its_journal_tells(data: Path) -> None:
    recovery = Recovery()
    with Shard.open(data, 0, recovery.begin) as shard:
        assert shard.read_ahead > LABELS
        ((name, folded),) = recovery.sessions(shard)
        assert (name, told(folded)) == (SESSION, told(fold(shard.events(SESSION))))


def test_what_only_the_mirror_held_takes_effect_behind_what_was_read_ahead(
    data: Path, tmp_path: Path
) -> None:
    files = [data / "shard-0" / name for name in (SQLITE_NAME, f"{SQLITE_NAME}-wal")]
    with Shard.open(data) as shard:
        for path in files:
            shutil.copyfile(path, tmp_path / path.name)
        for event in (TeacherJoined("bob"), Paused("bob")):
            kind, body = event_body(event)
            shard.append(SESSION, kind.value, body, at_ns=1)
    for path in files:
        shutil.copyfile(tmp_path / path.name, path)
    recovery = Recovery()
    with Shard.open(data, 0, recovery.begin) as shard:
        assert shard.read_ahead > LABELS
        ((_, folded),) = recovery.sessions(shard)
        assert told(folded) == told(fold(shard.events(SESSION)))
        assert (folded.session.paused, "bob" in folded.known) == (True, True)


def test_of_a_file_that_had_to_be_mended_the_session_is_rebuilt_from_its_beginning(data: Path) -> None:
    path = data / "shard-0" / SQLITE_NAME
    content = path.read_bytes()
    middle = content.rindex(bytes(4_000)) + 2_000  # a page holds 4,092 bytes of the padding
    path.write_bytes(content[:middle] + b"\x01" + content[middle + 1 :])
    recovery = Recovery()
    with Shard.open(data, 0, recovery.begin) as shard:
        assert (shard.read_ahead, len(shard.notes) > 0) == (0, True)
        ((_, folded),) = recovery.sessions(shard)
        assert told(folded) == told(fold(shard.events(SESSION)))


def test_a_session_that_this_version_cannot_read_is_named(data: Path) -> None:
    with Shard.open(data) as shard:
        shard.append(SESSION, Kind.STEP.value, b"\xc0", at_ns=0)
    recovery = Recovery()
    with Shard.open(data, 0, recovery.begin) as shard:
        assert shard.read_ahead == 0
        with pytest.raises(JournalError, match=f"session {SESSION}: its journal cannot be read"):
            tuple(recovery.sessions(shard))
