"""A data directory of several shards is read, proven, exported, copied and forgotten in as one."""

import json
from pathlib import Path

import pytest

from protocol.codec import decode
from protocol.status_message import ServiceStatus
from services.learner.ownership import agree_on_shards, shard_of
from services.operations.backup import backup
from services.operations.data_checks import data_checks
from services.operations.forget import forget
from services.operations.status import Found, shards_without_learner
from services.replay import replay_directory
from services.runtime.clock import SystemClock
from services.runtime.journal import JournalError, Shard, read_rows, verify
from tests.services.cli.command_line import sfid
from tests.services.learner.test_shards import NAMES, SHARDS, School

ANSWERS = 4


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory of three shards with six sessions that ann taught."""
    directory = tmp_path_factory.mktemp("several") / "data"
    agree_on_shards(directory, SHARDS)
    school = School(directory)
    for name in NAMES:
        school.create_named(name)
        school.join(name)
        for number in range(1, ANSWERS + 1):
            assert school.label(name, school.latest(name), number) is not None
    for shard in range(SHARDS):
        school.stop_shard(shard)
    return directory


def test_every_session_is_proven_and_replays(data: Path) -> None:
    found = verify(data)
    assert (found.ok, found.sessions, found.labels) == (True, len(NAMES), ANSWERS * len(NAMES))
    replayed = replay_directory(data)
    assert [one.session for one in replayed] == sorted(NAMES)
    assert all(one.matches for one in replayed)


@pytest.mark.parametrize("name", ["s1", "s2", NAMES[-1]])
def test_a_session_is_exported_whichever_shard_it_is_in(data: Path, name: str, tmp_path: Path) -> None:
    assert {shard_of(one, SHARDS) for one in NAMES} == {0, 1, 2}
    done = sfid(
        "export", str(data), "--session", name, "--format", "csv", "--out", str(tmp_path / "out"), "--json"
    )
    assert done.code == 0, done.stderr
    assert json.loads(done.stdout)["steps"] == ANSWERS


def test_the_doctor_looks_at_every_shard(data: Path) -> None:
    looked = [check.name for check in data_checks(data, prove=True)]
    assert {f"shard-{shard}" for shard in range(SHARDS)} <= set(looked)


def test_a_backup_keeps_the_number_of_shards_and_every_row(data: Path, tmp_path: Path) -> None:
    done = backup(data, tmp_path / "copy", SystemClock())
    assert [shard.path for shard in done.shards] == [f"shard-{shard}" for shard in range(SHARDS)]
    assert list(read_rows(tmp_path / "copy")) == list(read_rows(data))
    agree_on_shards(tmp_path / "copy", SHARDS)
    with pytest.raises(JournalError, match="lie in 3 shards, not in 1: pass --shards 3"):
        agree_on_shards(tmp_path / "copy", 1)


def test_a_person_is_forgotten_in_all_shards(data: Path, tmp_path: Path) -> None:
    backup(data, tmp_path / "copy", SystemClock())
    copy = tmp_path / "copy"
    done = forget(copy, "ann", SystemClock())
    assert len(done.sessions) == len(NAMES)
    assert verify(copy).ok
    left = [row for row in read_rows(copy) if row.person == "ann" or b"ann" in (row.body or b"")]
    assert left == []


def test_sessions_named_after_a_person_keep_different_names_over_the_shards(tmp_path: Path) -> None:
    data = tmp_path / "data"
    agree_on_shards(data, SHARDS)
    names = [next(f"ann-{n}" for n in range(99) if shard_of(f"ann-{n}", SHARDS) == k) for k in range(SHARDS)]
    school = School(data)
    for name in names:
        school.create_named(name)
        school.join(name)
        assert school.label(name, school.latest(name)) is not None
    for shard in range(SHARDS):
        school.stop_shard(shard)
    forget(data, "ann", SystemClock())
    assert [sessions_of(data, shard) for shard in range(SHARDS)] == [
        ("erased-1",),
        ("erased-1-1",),
        ("erased-2-1",),
    ]


def test_the_status_names_a_shard_that_has_no_learner(tmp_path: Path) -> None:
    school = School(tmp_path / "data")
    for learner in school.learners.values():
        assert decode(school.asked_status(learner), ServiceStatus).shards == SHARDS
    school.stop_shard(1)
    told = [
        Found("local", "learner", f"shard-{number}", decode(school.asked_status(learner), ServiceStatus))
        for number, learner in sorted(school.learners.items())
    ]
    missing = list(shards_without_learner(told))
    assert missing == [
        Found("local", "learner", "shard-1", None, "no learner has it: its sessions wait"),
    ]
    assert list(shards_without_learner([])) == []


def sessions_of(data: Path, shard: int) -> tuple[str, ...]:
    with Shard.open(data, shard) as opened:
        return opened.sessions()
