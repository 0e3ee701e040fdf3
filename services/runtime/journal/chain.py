"""The canonical bytes of a row and the hash chain over them (pure).

Every row commits to its erasable part (person and body) through a salted hash, the seal; the chain runs over
the rest and the seal. So a body can be erased, with its salt, and the chain still holds (README.md here).
"""

from __future__ import annotations

import hashlib
import struct
from typing import NamedTuple

HASH_BYTES = 32
SALT_BYTES = 16
UNIQUE_BYTES = 16
BODY_BYTES_MAX = 16 * 2**20

_SIZE = struct.Struct("<I")
_PUBLIC = struct.Struct("<QqHHB")
_PERSON = struct.Struct("<H")
_NOBODY = 0xFFFF
_NOBODY_PACKED = _PERSON.pack(_NOBODY)
_sha256 = hashlib.sha256
_NAMES_KEPT = 4096


class Row(NamedTuple):
    """One row as its readers see it.

    Attributes:
        seq: 1..n, dense over the shard.
        session: the session the row belongs to.
        kind: what the row is, for example "answer".
        at_ns: the writer's clock when the row was appended.
        body: the payload, or None when it was erased.
        unique: 16 bytes no other row of the session has, or None.
        person: the pseudonym the body speaks of, or None.
        amended: whether the body is what is read in place of an erased one.
    """

    seq: int
    session: str
    kind: str
    at_ns: int
    body: bytes | None
    unique: bytes | None
    person: str | None
    amended: bool = False


class Record(NamedTuple):
    """One row as it is stored: the columns of the table `rows`, in their order.

    Attributes: as in `Row`, and
        salt: 16 random bytes, or None when the row was erased.
        seal: SHA-256 of salt, person and body.
        chain: SHA-256 of the row before's chain, the public part and the seal.
    """

    seq: int
    session: str
    kind: str
    at_ns: int
    unique: bytes | None
    person: str | None
    salt: bytes | None
    body: bytes | None
    seal: bytes
    chain: bytes

    @property
    def row(self) -> Row:
        """The row without what only proves it."""
        return Row(self.seq, self.session, self.kind, self.at_ns, self.body, self.unique, self.person)


class BrokenChainError(ValueError):
    """A row does not follow from the row before it, or its body does not match its seal."""


def genesis(shard_id: bytes) -> bytes:
    """Return the chain value before row 1, which ties the chain to one shard."""
    return _sha256(b"sfid journal 1\0" + shard_id).digest()


def seal_row(prev: bytes, row: Row, salt: bytes) -> tuple[Record, bytes]:
    """Return the stored form of a new row and its canonical bytes.

    Args:
        prev: the chain value of the row before.
        row: the new row; its body is not None.
        salt: `SALT_BYTES` random bytes of its own.

    Raises:
        ValueError: a number or a text does not fit its field.
    """
    seq, session, kind, at_ns, body, unique, person, _ = row
    if body is None:
        message = "a new row has a body"
        raise ValueError(message)
    public = _public(seq, session, kind, at_ns, unique)
    private = _private(person, body)
    seal = _sha256(salt + private).digest()
    chain = _sha256(prev + public + seal).digest()
    size = _SIZE.pack(len(public) + 2 * HASH_BYTES + SALT_BYTES + len(private))
    record = Record(seq, session, kind, at_ns, unique, person, salt, body, seal, chain)
    return record, b"".join((size, public, seal, chain, salt, private))


def proven(prev: bytes, record: Record) -> bytes:
    """Return the canonical bytes of a stored row after checking its seal and that it follows `prev`.

    Raises:
        BrokenChainError: the row, or what stands where a row should be, does not hold.
    """
    return Prover(prev).prove(record)


class Prover:
    """Proves rows one after the other; a name that comes again is not encoded again.

    Attributes:
        chain: the chain value of the last row that was proven.
    """

    def __init__(self, chain: bytes) -> None:
        """Go on behind the row whose chain value is `chain`."""
        self.chain = chain
        self._names: dict[tuple[str, str], tuple[int, int, bytes]] = {}
        self._persons: dict[str | None, bytes] = {None: _NOBODY_PACKED}

    def prove(self, record: Record) -> bytes:
        """Return the canonical bytes of the next row; BrokenChainError when it does not hold."""
        seq, session, kind, at_ns, unique, person, salt, body, seal, chain = record
        try:
            sizes = self._names.get((session, kind)) or self._learn(session, kind)
            identity = unique or b""
            head = _PUBLIC.pack(seq, at_ns, sizes[0], sizes[1], len(identity))
            public = b"".join((head, sizes[2], identity))
            if body is None:
                secret = b""
                sealed = salt is None and person is None and len(seal) == HASH_BYTES
            else:
                name = self._persons.get(person) or self._learn_person(person)
                secret = b"".join((salt or b"", name, body))
                sealed = salt is not None and len(salt) == SALT_BYTES and _sha256(secret).digest() == seal
            if not sealed or _sha256(b"".join((self.chain, public, seal))).digest() != chain:
                raise BrokenChainError(seq)
        # A damaged file can hand back any type in any column.
        except (TypeError, AttributeError, ValueError, struct.error) as error:
            raise BrokenChainError(seq) from error
        self.chain = chain
        size = _SIZE.pack(len(public) + 2 * HASH_BYTES + len(secret))
        return b"".join((size, public, seal, chain, secret))

    def _learn(self, session: str, kind: str) -> tuple[int, int, bytes]:
        if len(self._names) >= _NAMES_KEPT:
            self._names.clear()
        name, sort = session.encode(), kind.encode()
        found = self._names[session, kind] = (len(name), len(sort), name + sort)
        return found

    def _learn_person(self, person: str | None) -> bytes:
        if len(self._persons) >= _NAMES_KEPT:
            self._persons = {None: _NOBODY_PACKED}
        found = self._persons[person] = _private(person, b"")
        return found


def rechained(prev: bytes, record: Record) -> Record:
    """Return a row, renamed or behind one that was, with the chain value that it has after `prev`."""
    public = _public(record.seq, record.session, record.kind, record.at_ns, record.unique)
    return record._replace(chain=_sha256(prev + public + record.seal).digest())


def decode_group(group: bytes) -> list[Record]:
    """Return the rows in a mirror frame's payload, unproven; ValueError when the bytes are not rows."""
    records = []
    at = 0
    try:
        while at < len(group):
            (size,) = _SIZE.unpack_from(group, at)
            at += _SIZE.size
            if size > len(group) - at:
                message = "a row runs past the end of its frame"
                raise ValueError(message)
            records.append(_decode(group[at : at + size]))
            at += size
    except struct.error as error:
        message = "a row is cut short"
        raise ValueError(message) from error
    return records


def _decode(data: bytes) -> Record:
    seq, at_ns, session_bytes, kind_bytes, unique_bytes = _PUBLIC.unpack_from(data)
    parts = []
    at = _PUBLIC.size
    for size in (session_bytes, kind_bytes, unique_bytes, HASH_BYTES, HASH_BYTES):
        parts.append(data[at : at + size])
        at += size
    session, kind, unique, seal, chain = parts
    if at > len(data):
        message = "a row is cut short"
        raise ValueError(message)
    salt, person, body = _decode_private(data[at:]) if at < len(data) else (None, None, None)
    return Record(
        seq, session.decode(), kind.decode(), at_ns, unique or None, person, salt, body, seal, chain
    )


def _decode_private(secret: bytes) -> tuple[bytes, str | None, bytes]:
    salt, at = secret[:SALT_BYTES], SALT_BYTES + _PERSON.size
    (size,) = _PERSON.unpack_from(secret, SALT_BYTES)
    if size == _NOBODY:
        return salt, None, secret[at:]
    return salt, secret[at : at + size].decode(), secret[at + size :]


def _public(seq: int, session: str, kind: str, at_ns: int, unique: bytes | None) -> bytes:
    name, sort = session.encode(), kind.encode()
    identity = unique or b""
    try:
        head = _PUBLIC.pack(seq, at_ns, len(name), len(sort), len(identity))
    except struct.error as error:
        raise ValueError(str(error)) from error
    return b"".join((head, name, sort, identity))


def _private(person: str | None, body: bytes) -> bytes:
    if person is None:
        return _NOBODY_PACKED + body
    name = person.encode()
    if len(name) >= _NOBODY:
        message = f"a pseudonym has at most {_NOBODY - 1} bytes, not {len(name)}"
        raise ValueError(message)
    return b"".join((_PERSON.pack(len(name)), name, body))
