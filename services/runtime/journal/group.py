"""The rows appended since the last commit, each already sealed and chained."""

from __future__ import annotations

import os

from services.runtime.journal.chain import SALT_BYTES, Record, Row, seal_row

_SALTS_DRAWN = 256


class Group:
    """What the next commit writes.

    Attributes:
        records: the rows, in order.
        encoded: their canonical bytes.
        size: the sum of those, in bytes.
        seq: the last row's number, pending or committed.
        chain: the last row's chain value, pending or committed.
    """

    def __init__(self, seq: int, chain: bytes) -> None:
        """Start behind the committed row `seq`."""
        self.seq = seq
        self.chain = chain
        self.records: list[Record] = []
        self.encoded: list[bytes] = []
        self.size = 0
        self._places: dict[tuple[str, bytes], int] = {}
        self._salts = b""
        self._salt_at = 0

    def restart(self, seq: int, chain: bytes) -> None:
        """Forget every row and go on behind the committed row `seq`."""
        self.seq = seq
        self.chain = chain
        self.records = []
        self.encoded = []
        self.size = 0
        self._places = {}

    def add(
        self, session: str, kind: str, at_ns: int, body: bytes, unique: bytes | None, person: str | None
    ) -> int:
        """Seal a row, chain it to the last, return its number; ValueError when a field does not fit."""
        seq = self.seq + 1
        row = Row(seq, session, kind, at_ns, body, unique, person)
        record, encoded = seal_row(self.chain, row, self._salt())
        if unique is not None:
            self._places[session, unique] = len(self.records)
        self.records.append(record)
        self.encoded.append(encoded)
        self.size += len(encoded)
        self.seq = seq
        self.chain = record.chain
        return seq

    def find(self, session: str, unique: bytes) -> Record | None:
        """Return the pending row with this unique id."""
        at = self._places.get((session, unique))
        return None if at is None else self.records[at]

    def drop_first(self, count: int) -> None:
        """Forget the first rows, because they turned out to be committed."""
        del self.records[:count]
        del self.encoded[:count]
        self.size = sum(map(len, self.encoded))
        self._places = {
            (record.session, record.unique): at
            for at, record in enumerate(self.records)
            if record.unique is not None
        }

    def _salt(self) -> bytes:
        at = self._salt_at
        # Drawn in bulk: one system call a row would cost as much as its hashes.
        if at == len(self._salts):
            self._salts = os.urandom(_SALTS_DRAWN * SALT_BYTES)
            at = 0
        self._salt_at = at + SALT_BYTES
        return self._salts[at : self._salt_at]
