"""Answers a teacher has given and nobody has acknowledged yet: kept before they are sent, deleted after."""

import sqlite3
import threading
from pathlib import Path
from types import TracebackType
from typing import Self


class OutboxError(Exception):
    """An answer cannot be kept; the message is one line: what is wrong, where, and the mend."""


class Outbox:
    """Payloads by answer id, oldest first: in a file when `path` is given, else in memory; for any thread.

    With a path `store` returns only after the answer is on the disk. Without one, answers die with the
    process: right for a scripted teacher, which derives the same answer again from its seed, wrong for a
    person.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._where = str(path) if path is not None else "memory"
        self._lock = threading.Lock()
        self._memory: dict[bytes, bytes] = {}
        self._file = _opened(path) if path is not None else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def store(self, answer_id: bytes, payload: bytes) -> None:
        """Keep an answer until `delete`. Raises OutboxError when it cannot be kept."""
        if self._file is None:
            with self._lock:
                self._memory[answer_id] = payload
        else:
            self._execute(
                "INSERT OR REPLACE INTO answers (answer_id, payload) VALUES (?, ?)", answer_id, payload
            )

    def delete(self, answer_id: bytes) -> None:
        """Forget an answer whose fate is known; an unknown id is no error. Raises OutboxError."""
        if self._file is None:
            with self._lock:
                self._memory.pop(answer_id, None)
        else:
            self._execute("DELETE FROM answers WHERE answer_id = ?", answer_id)

    def pending(self) -> list[tuple[bytes, bytes]]:
        """Return (answer id, payload) of what is kept, oldest first. Raises OutboxError."""
        if self._file is None:
            with self._lock:
                return list(self._memory.items())
        return self._execute("SELECT answer_id, payload FROM answers ORDER BY number")

    def close(self) -> None:
        """Let go of the file; twice is once."""
        if self._file is not None:
            with self._lock:
                self._file.close()

    def _execute(self, statement: str, *values: bytes) -> list[tuple[bytes, bytes]]:
        assert self._file is not None  # noqa: S101 - told to the type checker: callers have looked
        try:
            with self._lock:
                return self._file.execute(statement, values).fetchall()
        except sqlite3.Error as error:
            raise OutboxError(
                f"{self._where}: {error}; free the disk or choose another outbox file"
            ) from None


def _opened(path: Path) -> sqlite3.Connection:
    file: sqlite3.Connection | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = sqlite3.connect(path, isolation_level=None, check_same_thread=False, timeout=2.0)
        # FULL: an answer is on the disk when its insert returns. WAL: this costs one sync, not two.
        for statement in ("PRAGMA journal_mode = WAL", "PRAGMA synchronous = FULL"):
            file.execute(statement)
        file.execute(
            "CREATE TABLE IF NOT EXISTS answers"
            " (number INTEGER PRIMARY KEY AUTOINCREMENT,"
            " answer_id BLOB UNIQUE NOT NULL, payload BLOB NOT NULL)"
        )
    except (OSError, sqlite3.Error) as error:
        if file is not None:
            file.close()
        message = f"{path}: cannot keep answers there ({error}); choose a writable outbox file"
        raise OutboxError(message) from None
    return file
