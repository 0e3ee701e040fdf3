"""What a doctor looks at in a data directory: disk, permissions, journals, secrets."""

import os
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from services.operations.checks import Check, fail, ok, warn
from services.runtime.journal import JournalError, JournalNewer, verify
from services.runtime.journal.erasing import is_interrupted
from services.runtime.journal.lock import is_owned
from services.runtime.journal.store import SQLITE_NAME, open_read_only, read_head

SYNCS = 15
SYNC_SLOW_MS = 20.0
"""Half of an acknowledgement's usual time already: a label waits for two syncs side by side."""
FREE_LOW_BYTES, FREE_MIN_BYTES = 2**30, 100 * 2**20
_FAR = {"nfs", "nfs4", "cifs", "smb3", "smbfs", "9p", "fuse.sshfs", "ceph", "glusterfs"}
_FLEETING = {"tmpfs", "ramfs"}
_SECRET = ("secret", "people.json", "users", "register.jsonl")
_SECRET_SUFFIXES = (".login", ".key", ".token")
_OTHERS = stat.S_IRWXG | stat.S_IRWXO


def data_checks(data: Path, *, prove: bool = False) -> Iterator[Check]:
    """Yield every check of a data directory. Args: prove: also prove every row of its journals."""
    if not data.exists():
        place = next(parent for parent in data.absolute().parents if parent.exists())
        if not os.access(place, os.W_OK):
            yield fail(
                "data", f"{data} cannot be made in {place}", "name a --data directory that can be written"
            )
            return
        yield ok("data", f"{data} is not there yet; it will be made")
        yield from disk_checks(place)
        return
    yield _directory(data)
    yield from disk_checks(data)
    yield from _journals(data, prove=prove)
    yield _secrets(data)


def _directory(data: Path) -> Check:
    if not os.access(data, os.W_OK | os.X_OK):
        return fail(
            "data", f"{data} cannot be written by this user", f"chown it, or name another --data than {data}"
        )
    if data.stat().st_mode & _OTHERS:
        return warn("data", f"{data}: others on this machine can look into it", f"`chmod 700 {data}`")
    return ok("data", str(data))


def disk_checks(place: Path) -> Iterator[Check]:
    """Yield how full, how fast and how lasting the disk is."""
    free = shutil.disk_usage(place).free
    text = f"{free / 2**30:.1f} GiB free"
    if free < FREE_MIN_BYTES:
        yield fail("space", text, "free some: answers are refused when the disk is full")
    elif free < FREE_LOW_BYTES:
        yield warn("space", text, "free some: 100,000 answers take about 100 MiB")
    else:
        yield ok("space", text)
    kind = filesystem(place)
    if kind in _FAR:
        yield warn(
            "disk",
            f"{kind}: another machine's",
            "keep the journal on a local disk: locks and syncs there are not sure",
        )
    elif kind in _FLEETING:
        yield warn(
            "disk", f"{kind}: in memory, gone when the machine stops", "name a --data directory on a disk"
        )
    else:
        yield ok("disk", kind)
    yield _syncs(place)


def filesystem(place: Path) -> str:
    """Return the kind of file system that a directory is on; "unknown" where the system does not tell."""
    try:
        lines = Path("/proc/self/mounts").read_text().splitlines()
    except OSError:
        return "unknown"
    absolute = str(place.resolve())
    best, kind = "", "unknown"
    for line in lines:
        _, mount, found, *_ = line.split()
        mount = mount.replace("\\040", " ")
        inside = absolute == mount or absolute.startswith(mount.rstrip("/") + "/")
        if inside and len(mount) >= len(best):
            best, kind = mount, found
    return kind


def _syncs(place: Path) -> Check:
    took: list[float] = []
    sync = os.fdatasync if sys.platform == "linux" else os.fsync
    try:
        with tempfile.TemporaryFile(dir=place) as file:
            for _ in range(SYNCS):
                os.pwrite(file.fileno(), os.urandom(4096), 0)
                began = time.perf_counter()
                sync(file.fileno())
                took.append((time.perf_counter() - began) * 1000)
    except OSError as error:
        return fail(
            "sync", f"{place}: {error.strerror}", "look at the disk: nothing can be made durable there"
        )
    took.sort()
    text = f"{took[len(took) // 2]:.2f} ms, {took[-1]:.2f} at most"
    if took[len(took) // 2] > SYNC_SLOW_MS:
        return warn("sync", text, "an acknowledgement waits for it: take a faster disk")
    return ok("sync", text)


def _journals(data: Path, *, prove: bool) -> Iterator[Check]:
    shards = sorted(
        path for path in data.glob("**/shard-*") if path.is_dir() and not path.name.endswith(".part")
    )
    for shard in shards:
        yield _journal(shard, str(shard.relative_to(data)))
    if not shards:
        yield ok("journal", "none yet")
    elif prove:
        for root in sorted({shard.parent for shard in shards}):
            proof = verify(root)
            name = f"proof {root.relative_to(data)}" if root != data else "proof"
            if proof.ok:
                yield ok(name, f"{proof.rows} rows with {proof.labels} answers")
            else:
                mend = "start the service, which repairs what can be, or restore a backup"
                yield fail(name, proof.problems[0], mend)


def _journal(shard: Path, name: str) -> Check:
    live = is_owned(shard)
    try:
        with closing(open_read_only(shard, live=live)) as db:
            head = read_head(db, shard / SQLITE_NAME)
    except JournalNewer as error:
        return fail(name, str(error), "pip install the newer version")
    except (JournalError, OSError, ValueError) as error:
        return fail(name, str(error), "start the service, which repairs what can be, or restore a backup")
    except Exception as error:  # noqa: BLE001 - sqlite3's errors are many, and each is an answer here
        return fail(name, f"{type(error).__name__}: {error}", "start the service, which repairs what can be")
    text = f"{head.seq} rows, epoch {head.epoch}, " + ("a process writes it" if live else "nobody writes it")
    if is_interrupted(shard) and not live:
        return warn(
            name, f"{text}; an erasing was interrupted", "say `sfid forget` again, or start the service"
        )
    if shard.stat().st_mode & _OTHERS:
        return warn(name, f"{text}; others can look into it", f"`chmod 700 {shard}`")
    damaged = sorted(path.name for path in shard.glob("*.damaged-*"))
    if damaged:
        return warn(
            name, f"{text}; set aside by a repair: {', '.join(damaged)}", "look at them, then remove them"
        )
    return ok(name, text)


def _secrets(data: Path) -> Check:
    secrets = [
        path
        for path in sorted(data.rglob("*"))
        if path.is_file() and (path.name in _SECRET or path.suffix in _SECRET_SUFFIXES)
    ]
    readable = [path for path in secrets if path.stat().st_mode & _OTHERS]
    if readable:
        names = " ".join(str(path) for path in readable)
        return fail(
            "secrets", f"others can read {names}", f"`chmod 600 {names}`, and make new ones if others did"
        )
    return ok("secrets", f"{len(secrets)} files, readable by their owner alone")
