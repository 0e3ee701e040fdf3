"""A backup is whole, proven, and made beside a learner that goes on acknowledging."""

import json
import multiprocessing
import os
import shutil
import signal
import stat
import subprocess
import sys
from multiprocessing.synchronize import Event
from pathlib import Path

import pytest

from services.cli.shared.whereabouts import note_whereabouts
from services.operations.backup import MANIFEST, Backup, BackupError, backup
from services.replay import replay_directory
from services.runtime.clock import SystemClock
from services.runtime.journal import JournalError, Shard, read_rows, verify
from tests.services.cli.command_line import sfid
from tests.services.learner.classroom import Classroom
from tests.services.operations.test_forget import taught


def copied(data: Path, out: Path) -> Backup:
    return backup(data, out, SystemClock())


def rows_of(data: Path) -> list[tuple[int, bytes | None]]:
    return [(row.seq, row.body) for row in read_rows(data)]


def test_a_backup_holds_every_row_proves_itself_and_replays_to_the_same_table(tmp_path: Path) -> None:
    data, out = taught(tmp_path / "data"), tmp_path / "copy"
    (data / "gateway").mkdir()
    secret = data / "gateway" / "secret"
    secret.write_text("ab" * 32)
    secret.chmod(0o600)
    (data / "logs").mkdir()
    (data / "logs" / "learner.log").write_text("not a part of it\n")
    note_whereabouts(data, "tls/192.0.2.7:7447", "local")  # the machine's, and not a part of it either
    done = copied(data, out)
    assert rows_of(out) == rows_of(data)
    assert (verify(out).ok, done.rows) == (True, len(rows_of(data)))
    assert replay_directory(out)[0].q_sha256 == replay_directory(data)[0].q_sha256
    assert done.files == ["gateway/secret"]
    assert stat.S_IMODE((out / "gateway" / "secret").stat().st_mode) == 0o600
    assert stat.S_IMODE(out.stat().st_mode) == 0o700
    assert json.loads((out / MANIFEST).read_text())["shards"][0]["rows"] == done.rows
    assert not list(tmp_path.glob("*.part"))


def test_a_learner_goes_on_from_a_backup(tmp_path: Path) -> None:
    data, out = taught(tmp_path / "data"), tmp_path / "copy"
    copied(data, out)
    room = Classroom(out)
    digest = room.learner.sessions["s1"].session.learner.sha256()
    room.shard.close()
    assert digest == replay_directory(data)[0].q_sha256


def write_steadily(data: Path, told: int, stop: Event) -> None:
    """Commit rows and tell the number of each once it is durable."""
    with Shard.open(data) as shard, os.fdopen(told, "wb", 0) as line:
        number = 0
        while not stop.is_set():
            number += 1
            shard.append("s1", "answer", os.urandom(200), at_ns=number, unique=number.to_bytes(16, "big"))
            shard.commit()
            line.write(number.to_bytes(8, "big"))


def test_what_was_acknowledged_before_a_backup_began_is_in_it_while_the_writer_goes_on(
    tmp_path: Path,
) -> None:
    context = multiprocessing.get_context("fork")
    stop = context.Event()
    reader, writer = os.pipe()
    process = context.Process(target=write_steadily, args=(tmp_path / "data", writer, stop))
    process.start()
    os.close(writer)
    with os.fdopen(reader, "rb", 0) as told:
        for turn in range(5):
            acknowledged = int.from_bytes(told.read(8), "big")
            while len(os_ready := told.read(8)) == 8 and int.from_bytes(os_ready, "big") % 40:
                acknowledged = int.from_bytes(os_ready, "big")
            out = tmp_path / f"copy-{turn}"
            done = copied(tmp_path / "data", out)
            assert (verify(out).ok, process.is_alive()) == (True, True)
            assert done.rows >= acknowledged
            assert [seq for seq, _ in rows_of(out)] == list(range(1, done.rows + 1))
        stop.set()
        while told.read(4096):
            pass
    process.join(10)
    assert process.exitcode == 0


KILLED = """
import os, signal, sys
from pathlib import Path
from services.cli.shared.whereabouts import note_whereabouts
from services.operations.backup import backup
from services.runtime.clock import SystemClock

left = int(sys.argv[3])

def hook(event, arguments):
    global left
    if event in {"open", "os.rename", "os.mkdir", "os.remove", "sqlite3.connect"}:
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

sys.addaudithook(hook)
backup(Path(sys.argv[1]), Path(sys.argv[2]), SystemClock())
"""


def test_killed_at_any_moment_there_is_a_whole_backup_or_none_and_the_next_run_makes_it(
    tmp_path: Path,
) -> None:
    data = tmp_path / "data"
    with Shard.open(data) as shard:
        for number in range(100):
            shard.append("s1", "answer", b"body", at_ns=number, unique=number.to_bytes(16, "big"))
            shard.commit()
    expected = rows_of(data)
    kept, code, moment = 0, -signal.SIGKILL, 0
    while code != 0:
        moment += 8
        out = tmp_path / "copy"
        code = subprocess.run(
            [sys.executable, "-c", KILLED, str(data), str(out), str(moment)], check=False, timeout=60
        ).returncode
        assert code in {0, -signal.SIGKILL}
        if not out.exists():
            kept += copied(data, out).kept
        assert rows_of(out) == expected
        assert verify(out).ok
        shutil.rmtree(out)
    assert kept > 0


def test_a_damaged_journal_is_not_passed_on_as_a_backup(tmp_path: Path) -> None:
    data, out = taught(tmp_path / "data"), tmp_path / "copy"
    mirror = data / "shard-0" / "journal.mirror"
    spoilt = bytearray(mirror.read_bytes())
    spoilt[len(spoilt) // 2] ^= 1
    mirror.write_bytes(spoilt)
    with pytest.raises(BackupError, match="the copy does not prove itself"):
        copied(data, out)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data"]


def test_nothing_is_overwritten_and_nothing_is_copied_into_itself(tmp_path: Path) -> None:
    data = taught(tmp_path / "data")
    with pytest.raises(BackupError, match="is there already"):
        copied(data, data / "shard-0")
    with pytest.raises(BackupError, match="lies in the directory that is copied"):
        copied(data, data / "copy")
    with pytest.raises(JournalError, match="nowhere: No such file"):
        copied(tmp_path / "nowhere", tmp_path / "copy")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data"]


def test_the_command_tells_what_it_copied_and_fails_in_one_line(tmp_path: Path) -> None:
    data, out = taught(tmp_path / "data"), tmp_path / "copy"
    done = sfid("backup", str(data), str(out), "--json")
    told = json.loads(done.stdout)
    assert (done.code, told["rows"], told["labels"]) == (0, len(rows_of(data)), verify(data).labels)
    again = sfid("backup", str(data), str(out))
    assert (again.code, again.stderr.count("\n"), "is there already" in again.stderr) == (1, 1, True)
    assert sfid("verify", str(out)).code == 0
