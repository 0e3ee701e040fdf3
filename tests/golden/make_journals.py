"""Write the journals that every later version has to read: one of each version of the files.

    .venv/bin/python -m tests.golden.make_journals

A version that has been released is never written again; a new version adds a folder. The file of version 1 is
today's with the head that version 1 had, because rows, chain and mirror are the same.
"""

import json
import shutil
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path

from services.replay import replay_directory
from services.runtime.journal import verify
from services.runtime.journal.store import OLDER_HEAD, SCHEMA_VERSION
from tests.services.operations.test_forget import taught

JOURNALS = Path(__file__).with_name("journals")
FILES = ("journal.sqlite", "journal.mirror", "epoch")


def downgraded(path: Path) -> None:
    """Give a SQLite file of version 2 the head of version 1."""
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        head = db.execute("SELECT shard_id, epoch, seq, chain FROM head").fetchone()
        db.execute("PRAGMA journal_mode = DELETE")
        db.execute("DROP TABLE head")
        db.execute(OLDER_HEAD)
        db.execute("INSERT INTO head VALUES (1, ?, ?, ?, ?)", head)
        db.execute("PRAGMA user_version = 1")
        db.execute("PRAGMA journal_mode = WAL")


def write(folder: Path, data: Path) -> None:
    """Keep the files of a journal, and what is in them."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "shard-0").mkdir(parents=True)
    for name in FILES:
        shutil.copy(data / "shard-0" / name, folder / "shard-0" / name)
    proof, (replayed,) = verify(data), replay_directory(data)
    told = {"rows": proof.rows, "labels": proof.labels, "q_sha256": replayed.q_sha256}
    (folder / "expected.json").write_text(json.dumps(told) + "\n")


def main() -> None:
    """Write every version that this program can write."""
    with tempfile.TemporaryDirectory() as place:
        data = taught(Path(place) / "data")
        write(JOURNALS / f"version-{SCHEMA_VERSION}", data)
        downgraded(data / "shard-0" / "journal.sqlite")
        write(JOURNALS / "version-1", data)


if __name__ == "__main__":
    main()
