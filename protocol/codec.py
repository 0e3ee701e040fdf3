"""Bytes to messages and back: bounded, typed, one error class. The only file that imports msgpack.

There are two ways in with one meaning. The strict one unpacks with msgpack, looks at every key and lets
msgspec convert; it says of any bytes what they are, or what is wrong with them. The quick one reads a type
at once with msgspec, and is believed only where writing the value again gives the very same bytes: nothing
in them can then have been read leniently (a key twice, a whole number for a float, a field left out).
"""

from enum import Enum
from typing import Any, TypeVar

import msgpack
import msgspec

from protocol.messages import Wire

PAYLOAD_MAX = 65_536
"""64 KiB. The largest honest message (a level of 16 KiB with its view) is a third of it; a lying length
costs no memory."""

_BYTES = (bytes,)
"""Bytes are bytes on this wire; msgspec would else read text as base64 into them."""

M = TypeVar("M", bound=Wire)
T = TypeVar("T")


class DecodeFault(Enum):
    """Why a payload is not a message: a closed list, for counters."""

    TOO_LONG = "too-long"
    NOT_MSGPACK = "not-msgpack"
    NOT_THE_SCHEMA = "not-the-schema"


class DecodeError(ValueError):
    """A payload is not the message that was expected; nothing else escapes `decode`."""

    def __init__(self, fault: DecodeFault, detail: str) -> None:
        super().__init__(f"{fault.value}: {detail}")
        self.fault = fault
        self.detail = detail


_WRITER = msgspec.msgpack.Encoder()


def encode(message: Wire) -> bytes:
    """Return the message as a msgpack map with its `type` and `schema`."""
    return _WRITER.encode(message)


class _Readers(dict[Any, msgspec.msgpack.Decoder[Any]]):
    """A reader by the type, or union of types, that is expected; made when it is first asked for."""

    def __missing__(self, expected: Any) -> msgspec.msgpack.Decoder[Any]:  # noqa: ANN401 - a union is no type
        reader = self[expected] = msgspec.msgpack.Decoder(expected)
        return reader


_READERS = _Readers()


def decode(payload: bytes, expected: type[M]) -> M:
    """Return the message of the expected type (or union of types) that the payload holds.

    Args: payload: at most 64 KiB. Raises: DecodeError, and nothing else, whatever the bytes.
    """
    if len(payload) > PAYLOAD_MAX:
        raise DecodeError(DecodeFault.TOO_LONG, f"{len(payload)} bytes, the limit is {PAYLOAD_MAX}")
    message: M | None = _quickly(payload, expected)
    return decode_strictly(payload, expected) if message is None else message


def decode_strictly(payload: bytes, expected: type[M]) -> M:
    """Return what `decode` returns, also from bytes that another client has laid out in another way."""
    value = unpack(payload)
    # msgspec asks for the tag only where it has to choose between types, and `schema` has a default.
    if type(value) is dict and not ("type" in value and "schema" in value):
        raise DecodeError(DecodeFault.NOT_THE_SCHEMA, "`type` or `schema` is missing")
    return _converted(value, expected)


def read(body: bytes, expected: type[T]) -> T:
    """Return the plain value of the expected type, which is no message and not None, that a body holds.

    Raises: DecodeError, and nothing else.
    """
    value: T | None = _quickly(body, expected)
    return _converted(unpack(body), expected) if value is None else value


def _quickly(payload: bytes, expected: type[T]) -> T | None:
    """Return the value where the bytes are just what this codec writes for it, None where they may not be."""
    try:
        value: T = _READERS[expected].decode(payload)
        return value if _WRITER.encode(value) == payload else None
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None


def _converted(value: object, expected: type[T]) -> T:
    try:
        return msgspec.convert(value, expected, builtin_types=_BYTES)
    except msgspec.ValidationError as error:
        raise DecodeError(DecodeFault.NOT_THE_SCHEMA, printable(str(error))) from None


def unpack(payload: bytes) -> Any:  # noqa: ANN401 - any msgpack value, checked by the caller's schema
    """Return the plain value that the payload holds: no extension types, no key twice in a map.

    Raises: DecodeError.
    """
    try:
        return msgpack.unpackb(
            payload, raw=False, strict_map_key=True, object_pairs_hook=_each_once, ext_hook=_no_extension
        )
    except DecodeError:
        raise
    except (ValueError, TypeError, RecursionError, OverflowError, msgpack.UnpackException) as error:
        raise DecodeError(DecodeFault.NOT_MSGPACK, printable(str(error) or type(error).__name__)) from None


def _each_once(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    """Build a map in which each key stands once: of two, readers in other languages may take either."""
    found = dict(pairs)
    if len(found) != len(pairs):
        raise DecodeError(DecodeFault.NOT_MSGPACK, "a key stands twice")
    return found


def _no_extension(code: int, _data: bytes) -> Any:  # noqa: ANN401 - it never returns
    raise DecodeError(DecodeFault.NOT_MSGPACK, f"extension type {code}")


def pack(value: Any) -> bytes:  # noqa: ANN401 - any plain value
    """Return a plain value (maps, lists, numbers, text, bytes, None) as msgpack."""
    return _WRITER.encode(value)


def printable(text: str, length_max: int = 200) -> str:
    """Return the text for a log line: one line, no control characters, at most `length_max` characters."""
    shown = text[:length_max]
    return shown if shown.isprintable() else "".join([char if char.isprintable() else "?" for char in shown])
