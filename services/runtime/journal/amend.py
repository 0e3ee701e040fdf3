"""What is read in place of erased rows: bodies without the person, in rows of a kind of their own (pure).

    body of an `amended` row = for each row: seq u64 + length i32 (-1: nothing in its place) + new body

Such a row stands behind the rows it speaks of; readers never see it, they see what it says.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping

from services.runtime.journal.chain import Record, Row

AMENDED_KIND = "amended"
_ENTRY = struct.Struct("<Qi")
_NOTHING = -1
_BODY_BYTES = 2**20

Amendments = Mapping[int, bytes | None]
"""By row: what is read there from now on; None: nothing."""


def amendment_bodies(amendments: Amendments) -> Iterator[bytes]:
    """Yield the bodies of the rows that hold these amendments, each of about 1 MiB at most."""
    parts: list[bytes] = []
    size = 0
    for seq, body in sorted(amendments.items()):
        said = body or b""
        parts += (_ENTRY.pack(seq, _NOTHING if body is None else len(said)), said)
        size += _ENTRY.size + len(said)
        if size >= _BODY_BYTES:
            yield b"".join(parts)
            parts, size = [], 0
    if parts:
        yield b"".join(parts)


def read_amendments(bodies: Iterable[bytes]) -> dict[int, bytes | None]:
    """Return what rows of the kind say together; later ones take the place of earlier ones.

    Raises: ValueError when the bytes are none.
    """
    found: dict[int, bytes | None] = {}
    for body in bodies:
        at = 0
        while at < len(body):
            if len(body) - at < _ENTRY.size:
                message = "an amendment is cut short"
                raise ValueError(message)
            seq, size = _ENTRY.unpack_from(body, at)
            at += _ENTRY.size
            found[seq] = None if size == _NOTHING else body[at : at + size]
            at += max(size, 0)
    return found


def amended(records: Iterable[Record], amendments: Amendments) -> Iterator[Row]:
    """Yield rows as their readers see them."""
    for record in records:
        if record.kind == AMENDED_KIND:
            continue
        row = record.row
        if row.body is None and (body := amendments.get(row.seq)) is not None:
            row = row._replace(body=body, amended=True)
        yield row


def readable_events(
    stored: Iterable[tuple[int, str, int, bytes | None]], amendments: Amendments
) -> Iterator[tuple[str, int, bytes]]:
    """Yield (kind, at_ns, body) of rows (seq, kind, at_ns, body) that have a body, as readers see them."""
    for seq, kind, at_ns, own in stored:
        body = amendments.get(seq) if own is None else own
        if body is not None and kind != AMENDED_KIND:
            yield kind, at_ns, body


def erased(record: Record) -> Record:
    """Return a row without its person, salt and body; its seal and the chain stay."""
    return record._replace(person=None, salt=None, body=None)
