"""Writers killed, disks full and disks failing: whatever was acknowledged is in the journal exactly once."""

from __future__ import annotations

import os
import random
import re
import resource
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from services.runtime.journal import JournalError, JournalFull, Shard, read_rows, verify

WRITER = Path(__file__).parent / "journal_writer.py"
KILLS = 12


def acked_ids(output: str) -> list[bytes]:
    # The last line of a killed writer may be cut; only whole lines were acknowledgements.
    return [
        bytes.fromhex(line.split()[1]) for line in re.findall(r"^acked [0-9a-f]{32}$", output, re.MULTILINE)
    ]


def assert_kept_exactly_once(data_dir: Path, acked: list[bytes]) -> None:
    counts = Counter(row.unique for row in read_rows(data_dir))
    assert max(counts.values(), default=1) == 1
    assert [unique for unique in acked if counts[unique] != 1] == []
    bodies = {row.unique: row.body for row in read_rows(data_dir)}
    assert all((bodies[unique] or b"").startswith(unique) for unique in acked)


def test_a_writer_killed_at_random_points_loses_no_acknowledged_row(tmp_path: Path) -> None:
    rng = random.Random(3)
    acked: list[bytes] = []
    for kill in range(KILLS):
        command = [sys.executable, str(WRITER), str(tmp_path), str(kill), "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            assert writer.stdout is not None
            head = [writer.stdout.readline() for _ in range(rng.randrange(1, 200))]
            writer.kill()
            acked += acked_ids("".join(head) + writer.stdout.read())
        found = verify(tmp_path)
        assert found.problems == ()
        assert_kept_exactly_once(tmp_path, acked)
    with Shard.open(tmp_path) as shard:
        assert shard.epoch == KILLS + 1
    assert_kept_exactly_once(tmp_path, acked)
    assert verify(tmp_path).problems == ()
    assert len(acked) > KILLS


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MiB."""
    mount, umount = shutil.which("mount"), shutil.which("umount")
    point = tmp_path / "disk"
    point.mkdir()
    if mount is None or umount is None:
        pytest.skip("needs mount")
    done = subprocess.run(
        [mount, "-t", "tmpfs", "-o", "size=1m", "journal-test", str(point)], check=False, capture_output=True
    )
    if done.returncode != 0:
        pytest.skip("needs the right to mount a tmpfs")
    yield point
    subprocess.run([umount, str(point)], check=True)


def fill(shard: Shard, committed: list[int]) -> None:
    for number in range(1000):
        shard.append("s", "answer", bytes(2000), at_ns=number, unique=number.to_bytes(16, "big"))
        shard.commit()
        committed.append(number)


def test_a_full_disk_is_reported_and_the_same_writer_goes_on_once_there_is_space(small_disk: Path) -> None:
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes(400 * 1024))
    committed: list[int] = []
    with Shard.open(small_disk / "data") as shard:
        with pytest.raises(JournalFull, match="no space"):
            fill(shard, committed)
        for _ in range(3):
            with pytest.raises(JournalFull):
                shard.commit()
        assert len(list(read_rows(small_disk / "data"))) == len(committed) > 0
        assert shard.find("s", len(committed).to_bytes(16, "big")) is not None
        ballast.unlink()
        shard.commit()
        shard.append("s", "answer", b"after", at_ns=0, unique=b"f" * 16)
        shard.commit()
        assert verify(small_disk / "data").problems == ()
    ids = [row.unique for row in read_rows(small_disk / "data")]
    assert ids == [*(number.to_bytes(16, "big") for number in range(len(committed) + 1)), b"f" * 16]
    assert verify(small_disk / "data").problems == ()


def test_rows_that_met_a_full_disk_can_be_discarded(small_disk: Path) -> None:
    with Shard.open(small_disk / "data") as shard:
        shard.append("s", "answer", b"kept", at_ns=0)
        shard.commit()
        shard.append("s", "answer", bytes(2**20), at_ns=1)
        with pytest.raises(JournalFull):
            shard.commit()
        shard.discard_pending()
        shard.append("s", "answer", b"small", at_ns=2)
        shard.commit()
    assert [(row.seq, row.body) for row in read_rows(small_disk / "data")] == [(1, b"kept"), (2, b"small")]
    assert verify(small_disk / "data").problems == ()


@pytest.mark.parametrize("failing", ["journal.mirror", "journal.sqlite-wal"])
@pytest.mark.parametrize("then", ["commit", "discard"])
def test_after_a_failed_write_the_files_are_opened_anew_and_the_group_is_whole_or_gone(
    tmp_path: Path, failing: str, then: str
) -> None:
    """A limit on file sizes makes the kernel refuse the write in the middle of a frame or of a WAL page."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Shard.open(tmp_path) as shard:
        shard.append("s", "answer", b"kept" * 100, at_ns=0)
        shard.commit()
        shard.append("s", "answer", b"in doubt" * 100, at_ns=1, unique=b"u" * 16)
        resource.setrlimit(
            resource.RLIMIT_FSIZE, ((tmp_path / "shard-0" / failing).stat().st_size + 100, hard)
        )
        try:
            with pytest.raises(JournalError, match=r"\S"):
                shard.commit()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        if then == "commit":
            shard.commit()
        else:
            shard.discard_pending()
        shard.append("s", "answer", b"after", at_ns=2)
        shard.commit()
        assert verify(tmp_path).problems == ()
    middle = [b"in doubt" * 100] if then == "commit" else []
    assert [row.body for row in read_rows(tmp_path)] == [b"kept" * 100, *middle, b"after"]
    assert verify(tmp_path).problems == ()


def traced(tmp_path: Path, *options: str, seed: int = 1) -> tuple[subprocess.CompletedProcess[str], str]:
    strace = shutil.which("strace")
    if strace is None:
        pytest.skip("needs strace")
    trace = tmp_path / "trace"
    command = [strace, "-f", "-qq", "-y", "-o", str(trace), *options]
    with (tmp_path / "said").open("w") as said:
        done = subprocess.run(
            [*command, sys.executable, str(WRITER), str(tmp_path / "data"), str(seed), "10"],
            check=False,
            stdout=said,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
            timeout=60,
        )
    done.stdout = (tmp_path / "said").read_text()
    if not trace.exists() or not re.search("fdatasync|pwrite64", trace.read_text()):
        pytest.skip("strace may not trace here")
    return done, trace.read_text()


def story_of(trace: str) -> str:
    """Return what ended when: m the mirror's sync, w the WAL's sync, a one id's acknowledgement."""
    marks = {
        r"f(data)?sync\(.*journal\.mirror>": "m",
        r"f(data)?sync\(.*journal\.sqlite-wal>": "w",
        '"acked ': "a",
    }
    unfinished: dict[str, str] = {}
    story = []
    for line in trace.splitlines():
        thread = line.split()[0]
        mark = next((mark for pattern, mark in marks.items() if re.search(pattern, line)), "")
        if "unfinished ..." in line:
            unfinished[thread] = mark
        elif "resumed>" in line:
            story.append(unfinished.pop(thread, ""))
        else:
            story.append(mark)
    return "".join(story)


def test_every_acknowledgement_follows_a_finished_sync_of_the_mirror_and_one_of_sqlite(
    tmp_path: Path,
) -> None:
    done, trace = traced(tmp_path, "-e", "trace=fdatasync,fsync,write")
    assert done.returncode == 0
    story = story_of(trace)
    first = re.search("(mw|wm)a", story)
    assert first is not None, story
    assert re.fullmatch(r"((mw|wm)a{1,5}){10}[mw]*", story[first.start() :]), story


@pytest.mark.parametrize("name, mark", [("journal.mirror", "m"), ("journal.sqlite-wal", "w")])
def test_the_acknowledgement_waits_for_whichever_of_the_two_syncs_is_late(
    tmp_path: Path, name: str, mark: str
) -> None:
    Shard.open(tmp_path / "data").close()
    late = ["-P", str(tmp_path / "data" / "shard-0" / name), "-e", "inject=fdatasync:delay_exit=20000"]
    done, trace = traced(tmp_path, *late, "-P", str(tmp_path / "said"), "-e", "trace=fdatasync,write")
    assert done.returncode == 0
    story = story_of(trace)
    assert re.fullmatch(f"{mark}*({mark}a{{1,5}}){{10}}{mark}*", story), story


@pytest.mark.parametrize(
    "name, call, when",
    [
        ("journal.mirror", "pwrite64", "2"),
        ("journal.mirror", "pwrite64", "3..4"),
        ("journal.mirror", "fdatasync", "2"),
        ("journal.mirror", "fdatasync", "3..4"),
        # The first calls on the WAL are those of the opening.
        ("journal.sqlite-wal", "pwrite64", "7"),
        ("journal.sqlite-wal", "pwrite64", "20..21"),
        ("journal.sqlite-wal", "fdatasync", "4"),
        ("journal.sqlite-wal", "fdatasync", "5..6"),
    ],
)
@pytest.mark.parametrize("error", ["ENOSPC", "EIO"])
def test_when_one_of_the_two_files_fails_the_other_is_brought_back_to_the_same_rows(
    tmp_path: Path, name: str, call: str, when: str, error: str
) -> None:
    Shard.open(tmp_path / "data").close()
    failing = tmp_path / "data" / "shard-0" / name
    inject = f"inject={call}:error={error}:when={when}"
    done, trace = traced(tmp_path, "-P", str(failing), "-e", f"trace={call}", "-e", inject)
    assert trace.count("(INJECTED)") >= 1
    assert trace.count(name) == trace.count(f"{call}(")
    assert done.returncode == 0, done.stderr
    # Each failure is the disk's own; none follows from how the one before it was handled.
    errors = re.findall("^error .*", done.stdout, re.MULTILINE)
    assert errors
    assert [line for line in errors if not re.search("no space left|full|[Ii]nput/output|I/O", line)] == []
    assert_kept_exactly_once(tmp_path / "data", acked_ids(done.stdout))
    assert len(list(read_rows(tmp_path / "data"))) == len(acked_ids(done.stdout))
    found = verify(tmp_path / "data")
    assert (found.problems, found.notes) == ((), ())


@pytest.mark.parametrize(
    "name, call, whens",
    [
        ("journal.mirror", "pwrite64", range(1, 7)),
        ("journal.mirror", "fdatasync", range(1, 7)),
        ("journal.sqlite-wal", "pwrite64", range(7, 61, 9)),
        ("journal.sqlite-wal", "fdatasync", range(4, 10)),
    ],
)
def test_a_writer_killed_in_a_call_on_either_file_loses_no_acknowledged_row(
    tmp_path: Path, name: str, call: str, whens: range
) -> None:
    acked: list[bytes] = []
    Shard.open(tmp_path / "data").close()
    failing = tmp_path / "data" / "shard-0" / name
    for when in whens:
        inject = f"inject={call}:error=EIO:signal=KILL:when={when}"
        done, _ = traced(tmp_path, "-P", str(failing), "-e", f"trace={call}", "-e", inject, seed=when)
        assert done.returncode != 0
        acked += acked_ids(done.stdout)
        assert verify(tmp_path / "data").problems == ()
        assert_kept_exactly_once(tmp_path / "data", acked)
    assert acked
    with Shard.open(tmp_path / "data") as shard:
        assert {row.unique for row in shard.rows()} >= set(acked)
    found = verify(tmp_path / "data")
    assert (found.problems, found.notes) == ((), ())


@pytest.mark.parametrize(
    "failing_sync", ["5", "12", "14", "15", "16", "17", "25", "14..16", "15..17", "17..21"]
)
def test_a_sync_that_fails_is_never_an_acknowledgement_and_the_writer_goes_on(
    tmp_path: Path, failing_sync: str
) -> None:
    inject = f"inject=fdatasync,fsync:error=EIO:when={failing_sync}"
    done, trace = traced(tmp_path, "-e", "trace=fdatasync,fsync", "-e", inject)
    assert trace.count("EIO") >= 1
    if "open 1" in done.stdout:
        assert done.returncode == 0, done.stderr
    else:
        # The failure met the opening: refused, and the next opening finds a sound journal.
        assert "JournalError" in done.stderr
        Shard.open(tmp_path / "data").close()
    assert verify(tmp_path / "data").problems == ()
    assert_kept_exactly_once(tmp_path / "data", acked_ids(done.stdout))
