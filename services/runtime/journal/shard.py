"""One shard of the journal: rows appended by one learner, durable when `commit` returns."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from services.runtime.journal.amend import (
    AMENDED_KIND,
    Amendments,
    amended,
    amendment_bodies,
    read_amendments,
    readable_events,
)
from services.runtime.journal.beside import Meanwhile
from services.runtime.journal.chain import BODY_BYTES_MAX, UNIQUE_BYTES, Row
from services.runtime.journal.erasing import begin_erasing
from services.runtime.journal.errors import (
    JournalDuplicate,
    JournalError,
    JournalFenced,
    JournalFull,
    translated,
)
from services.runtime.journal.group import Group
from services.runtime.journal.lock import ShardLock
from services.runtime.journal.mirror import MIRROR_NAME, Mirror
from services.runtime.journal.opening import open_files

# Half of what a frame may hold, so that the row which crosses the line still fits.
PENDING_BYTES_MAX = 32 * 2**20


def shard_directory(data_dir: Path, shard: int) -> Path:
    """Return where shard number `shard` of a deployment lives."""
    return data_dir / f"shard-{shard}"


class Shard:
    """The writer of one shard; open it with `Shard.open`, not for two threads at once.

    A commit begins a transaction that proves that this writer still owns the epoch, writes the mirror, and
    then syncs the mirror while it commits SQLite. When `commit` fails, nothing of the group counts as written
    and all of it stays pending: commit again, or `discard_pending`. After `JournalFull` the same files are
    used again. After any other error, and after any failed sync of the mirror, they are not trusted: the next
    commit or discard opens them anew and verifies them, and rows that did reach the disk are known by their
    chain value and not written twice. After `JournalFenced` no commit can succeed.

    Attributes:
        directory: where the files are.
        epoch: this writer's number; every later owner has a higher one.
        syncs: how many syncs commits have asked the disk for, two a commit.
        notes: what opening had to mend, one line each.
        read_ahead: how many rows `meanwhile` was shown that are just what the journal holds.
        mirror_type: what writes the mirror.
    """

    mirror_type: type[Mirror] = Mirror

    def __init__(self, directory: Path, lock: ShardLock, meanwhile: Meanwhile | None = None) -> None:
        """Take over the files in `directory` under its `lock`; callers use `Shard.open`."""
        self.directory = directory
        self.syncs = 0
        self._lock = lock
        self._closed = False
        self._suspect = False
        self._missed: tuple[str, bytes] | None = None
        opened = open_files(directory, self.mirror_type, meanwhile)
        self._store, self._mirror, self._head, self.notes, self.read_ahead = opened
        self.epoch = self._head.epoch
        self._group = Group(self._head.seq, self._head.chain)
        self._amendments = self._read_amendments()

    @classmethod
    def open(cls, data_dir: Path, shard: int = 0, meanwhile: Meanwhile | None = None) -> Self:
        """Open or create a shard as its only writer, repairing what a crash or a damaged file left.

        Args:
            data_dir: the deployment's directory; created with mode 0700.
            shard: its number, from 0.
            meanwhile: reads rows of a large shard while they are still being proven; what it made of them
                stands if `read_ahead` then counts them, and is to be forgotten if it is 0.

        Raises:
            JournalLocked: another process owns it.
            JournalNewer: a newer version wrote it.
            JournalDamaged: rows are missing from both files.
            JournalError: the path cannot be used.
        """
        directory = shard_directory(data_dir, shard)
        with translated(directory):
            data_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
            directory.mkdir(mode=0o700, exist_ok=True)
        lock = ShardLock(directory)
        try:
            return cls(directory, lock, meanwhile)
        except BaseException:
            lock.release()
            raise

    def append(
        self,
        session: str,
        kind: str,
        body: bytes,
        *,
        at_ns: int,
        unique: bytes | None = None,
        person: str | None = None,
    ) -> int:
        """Add a row to the open group and return its seq; it is durable when the next `commit` returns.

        Args:
            session: the session it belongs to.
            kind: what it is; "answer" marks a label.
            body: at most 16 MiB.
            at_ns: the caller's clock, int64.
            unique: an answer's id, 16 bytes, never used before in this session.
            person: the pseudonym the body speaks of; erased together with it.

        Raises:
            JournalDuplicate: the session already has a row with this `unique`, committed or pending.
            JournalError: more than 32 MiB are pending, or the shard is closed.
            ValueError: an argument does not fit its field.
        """
        group = self._group
        if self._closed or group.size > PENDING_BYTES_MAX:
            raise self._refusal()
        if len(body) > BODY_BYTES_MAX:
            message = f"a body has at most {BODY_BYTES_MAX} bytes, not {len(body)}"
            raise ValueError(message)
        if unique is not None:
            self._refuse_duplicate(session, unique)
        return group.add(session, kind, at_ns, body, unique, person)

    def find(self, session: str, unique: bytes) -> Row | None:
        """Return the session's row with this unique id, committed or pending, None when there is none."""
        found = self._group.find(session, unique) or self._store.find(session, unique)
        if found is None:
            self._missed = (session, unique)
            return None
        return found.row

    def commit(self) -> None:
        """Make every appended row durable in both files, or raise and leave them pending (see the class).

        Raises:
            JournalFull: no space; free some and commit again.
            JournalFenced: another learner owns the shard now.
            JournalError: the disk failed, or the shard is closed.
        """
        if self._closed:
            raise self._refusal()
        if self._suspect:
            self._reopen()
        # Also without a row: what is told after a commit must not be an owner's word that is none any more.
        self._lock.check()
        group = self._group
        if not group.records:
            return
        try:
            self._store.advance(self.epoch, group.records[-1])
            self._mirror.write(b"".join(group.encoded))
            self._sync_both()
        except BaseException as error:
            # A mirror in doubt may go with a SQLite that has committed, whatever the error says.
            self._suspect = self._mirror.in_doubt or not isinstance(error, (JournalFull, JournalFenced))
            self._undo()
            raise
        self._mirror.settle()
        self.syncs += 2
        self._head = self._head._replace(seq=group.seq, chain=group.chain)
        group.restart(group.seq, group.chain)

    def discard_pending(self) -> None:
        """Forget every row appended since the last commit that succeeded; their numbers are used again.

        After a failed disk, rows that turn out to have reached it stay (see the class).
        """
        if self._suspect:
            self._reopen()
        self._group.restart(self._head.seq, self._head.chain)

    def rows(self, session: str | None = None, after_seq: int = 0) -> Iterator[Row]:
        """Yield the rows in order, the pending ones last.

        Args:
            session: only this session's, None for all.
            after_seq: only rows with a higher seq.
        """
        through = self._head.seq
        pending = tuple(self._group.records)
        yield from amended(self._store.records(session, after_seq, through), self._amendments)
        for record in pending:
            if record.seq > after_seq and session in (None, record.session):
                yield record.row

    def events(self, session: str, after_seq: int = 0) -> Iterator[tuple[str, int, bytes]]:
        """Yield (kind, at_ns, body) of a session's rows that have a body, in order, as `rows` shows them.

        Several times faster than `rows`, for those who rebuild a long session.
        """
        pending = tuple(self._group.records)
        stored = self._store.events(session, after_seq, self._head.seq)
        yield from readable_events(stored, self._amendments)
        for record in pending:
            if record.seq > after_seq and record.session == session and record.body is not None:
                yield record.kind, record.at_ns, record.body

    def erase(
        self, by_session: Mapping[str, Amendments], *, at_ns: int, renamed: Mapping[str, str] | None = None
    ) -> int:
        """Erase rows for ever, salt and person included, and return how many that were.

        Both files are written anew, so that neither keeps the bytes, and so is what earlier repairs set
        aside. Killed at any moment, the next opening completes the erasing or leaves all as it was.

        Args:
            by_session: rows to erase, by session and seq, with what is read in their place: a body that
                speaks of nobody, or None for nothing.
            at_ns: the caller's clock.
            renamed: other names for sessions whose names speak of a person and of which all is erased; the
                chain is then computed anew.

        Raises:
            JournalFull, JournalError: as `commit`; when an opening then says so, it was completed.
        """
        self.commit()
        wanted = sum(len(amendments) for amendments in by_session.values())
        if not wanted:
            return 0
        begin_erasing(self.directory, renamed or {})
        before = self._store.amended_rows()
        for session, amendments in by_session.items():
            # What was said before, may itself have to be corrected: it is said anew, and the old row erased.
            old = {seq: body for seq, name, body in before if name == session}
            said = read_amendments(old.values()) | dict.fromkeys(old) | dict(amendments)
            for body in amendment_bodies(said):
                if self._group.size > PENDING_BYTES_MAX // 2:
                    self.commit()
                self.append(session, AMENDED_KIND, body, at_ns=at_ns)
        self.commit()
        self._store.checkpoint()
        self._store.close()
        self._mirror.close()
        self._lock.check()
        # Opening finds the marker and writes both files anew.
        self._store, self._mirror, self._head, notes, _ = open_files(self.directory, self.mirror_type)
        self.epoch = self._head.epoch
        self.notes = (*self.notes, *notes)
        self._group.restart(self._head.seq, self._head.chain)
        self._amendments = self._read_amendments()
        return wanted

    def sessions(self) -> tuple[str, ...]:
        """Return every session that has a row, in the order of their first ones."""
        names = (*self._store.sessions(), *(record.session for record in self._group.records))
        return tuple(dict.fromkeys(names))

    def close(self) -> None:
        """Commit, move the WAL into the database file and give the shard back; safe to call twice.

        Raises:
            JournalError: as `commit`; the shard is given back all the same.
        """
        if self._closed:
            return
        try:
            self.commit()
            # Without space the WAL simply stays; it is as durable as the file.
            with suppress(JournalError):
                self._store.checkpoint()
        finally:
            self._closed = True
            self._store.close()
            self._mirror.close()
            self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        # The error on its way out matters more than a second one from closing.
        with suppress(JournalError):
            self.close()

    def _read_amendments(self) -> Amendments:
        return read_amendments(body for _, _, body in self._store.amended_rows())

    def _reopen(self) -> None:
        """Open the files anew after an error of the disk, and drop the pending rows that had reached it."""
        before, path = self._head, self.directory / MIRROR_NAME
        self._store.close()
        self._mirror.close()
        self._lock.check()
        # What the failed group left in the mirror was perhaps never synced; it is written again.
        with translated(path):
            os.truncate(path, self._mirror.end)
        self._store, self._mirror, head, notes, _ = open_files(self.directory, self.mirror_type)
        # A page whose sync failed may be only in memory though it reads well; this writes every one again.
        self._store.checkpoint()
        written = head.seq - before.seq
        pending = self._group.records
        if not 0 <= written <= len(pending) or (written and pending[written - 1].chain != head.chain):
            message = f"{self.directory}: its last {written} rows are not this writer's; stop it"
            raise JournalFenced(message)
        self._group.drop_first(written)
        self._head = head
        self.epoch = head.epoch
        self.notes = (*self.notes, *notes)
        self._suspect = False

    def _sync_both(self) -> None:
        """Commit SQLite while the mirror is synced; return when both are durable."""
        self._mirror.start_sync()
        try:
            self._store.commit(self._group.records)
        finally:
            self._mirror.wait_synced()

    def _undo(self) -> None:
        """Take the failed group out of both files; what cannot be taken out makes them suspect."""
        # The mirror first, while the transaction keeps a new owner out: what it writes must not be cut.
        steps = (
            (self._store.roll_back,) if self._suspect else (self._mirror.drop_written, self._store.roll_back)
        )
        for step in steps:
            try:
                step()
            except JournalError:
                self._suspect = True

    def _refuse_duplicate(self, session: str, unique: bytes) -> None:
        if len(unique) != UNIQUE_BYTES:
            message = f"a unique id has {UNIQUE_BYTES} bytes, not {len(unique)}"
            raise ValueError(message)
        # The caller has usually just asked `find`; asking once is enough, because nobody else writes.
        asked = self._missed == (session, unique)
        found = None if asked else self.find(session, unique)
        self._missed = None
        if found is not None:
            message = f"session {session}: id {unique.hex()} is already in the journal; answer from that row"
            raise JournalDuplicate(message)

    def _refusal(self) -> JournalError:
        if self._closed:
            return JournalError(f"{self.directory}: the journal is closed; open it again")
        return JournalError(
            f"{self.directory}: {self._group.size} bytes are pending; commit before appending"
        )
