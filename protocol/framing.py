"""Frames of the journal's mirror log: magic, length, CRC-32, payload; and the rule for a torn tail.

A frame is 4 bytes of magic, the payload's length (uint32, little endian), the CRC-32 of that length and the
payload (uint32, little endian), and the payload. The magic lets a reader find the next frame after a damaged
one; the CRC covers the length, so that no frame passes with another length than it was written with.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple, Protocol

MAGIC = b"SfJ\xf1"
HEADER_BYTES = 12
# A writer commits long before this much is pending (the journal's own limit is half), so more is damage.
PAYLOAD_BYTES_MAX = 64 * 2**20

_LENGTH = struct.Struct("<I")
_HEADER = struct.Struct("<4sII")


class Readable(Protocol):
    """A binary file positioned where the next frame should begin."""

    def read(self, size: int, /) -> bytes:
        """Return up to `size` bytes, fewer only at the end."""
        ...


class Frame(NamedTuple):
    """One whole frame and the offsets of its first byte and of the byte after it."""

    start: int
    end: int
    payload: bytes


def frame(payload: bytes) -> bytes:
    """Return the bytes of one frame; ValueError when the payload exceeds `PAYLOAD_BYTES_MAX`."""
    if len(payload) > PAYLOAD_BYTES_MAX:
        message = f"a frame holds at most {PAYLOAD_BYTES_MAX} bytes, not {len(payload)}"
        raise ValueError(message)
    length = _LENGTH.pack(len(payload))
    return b"".join((MAGIC, length, _LENGTH.pack(_checksum(length, payload)), payload))


def frames(log: Readable, start: int = 0) -> Iterator[Frame]:
    """Yield whole frames in order and stop before the first byte that does not begin one.

    Args:
        log: positioned at `start`.
        start: the offset in the log that `log` is positioned at.
    """
    while True:
        payload = _payload(log.read(HEADER_BYTES), log)
        if payload is None:
            return
        end = start + HEADER_BYTES + len(payload)
        yield Frame(start, end, payload)
        start = end


def whole_frames_within(rest: bytes, start: int = 0) -> Iterator[Frame]:
    """Yield every whole frame that begins anywhere in `rest`, skipping damaged bytes between them.

    Args:
        rest: the log from the first byte that begins no whole frame.
        start: the offset of `rest` in the log.
    """
    at = rest.find(MAGIC)
    while at >= 0:
        header = rest[at : at + HEADER_BYTES]
        payload = _payload(header, _Window(rest, at + HEADER_BYTES))
        if payload is None:
            at = rest.find(MAGIC, at + 1)
            continue
        end = at + HEADER_BYTES + len(payload)
        yield Frame(start + at, start + end, payload)
        at = rest.find(MAGIC, end)


def is_torn_tail(rest: bytes) -> bool:
    """Tell whether the bytes after the last whole frame are an unfinished write rather than damage.

    The writer syncs each frame before it writes the next, so an unfinished write is followed by nothing: a
    whole frame anywhere behind the break proves that bytes which were once synced have changed.
    """
    return next(whole_frames_within(rest), None) is None


class _Window:
    """Reads from bytes in memory without copying what is not asked for."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data = data
        self._at = at

    def read(self, size: int, /) -> bytes:
        return self._data[self._at : self._at + size]


def _payload(header: bytes, log: Readable) -> bytes | None:
    if len(header) < HEADER_BYTES:
        return None
    magic, length, checksum = _HEADER.unpack(header)
    if magic != MAGIC or length > PAYLOAD_BYTES_MAX:
        return None
    payload = log.read(length)
    if len(payload) < length or _checksum(header[4:8], payload) != checksum:
        return None
    return payload


def _checksum(length: bytes, payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(length))
