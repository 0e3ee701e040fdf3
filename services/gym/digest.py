"""A state's key is the digest of what the environment lets be observed."""

from hashlib import blake2b
from typing import Any

import numpy as np

from services.gym.errors import GymError

KEY_BYTES = 16


def state_key(observation: Any) -> bytes:  # noqa: ANN401 - environments observe what they like
    """Return the 16-byte key of an observation: equal where and only where the observation is.

    States that look the same are the same to a table: where an environment shows only a part of itself
    (MiniGrid's view of seven by seven cells), what is learnt in one place counts in all that look like it.

    Raises: GymError for what is neither numbers, text, arrays of whole numbers nor made of these.
    """
    digest = blake2b(digest_size=KEY_BYTES)
    for piece in _pieces(observation):
        digest.update(len(piece).to_bytes(8, "little"))
        digest.update(piece)
    return digest.digest()


def _pieces(value: Any) -> list[bytes]:  # noqa: ANN401 - as above
    """Return the value as pieces of bytes, each kind under a letter of its own."""
    match value:
        case bool() | np.bool_():
            return [b"b", b"1" if value else b"0"]
        case int() | np.integer():
            return [b"i", str(int(value)).encode()]
        case str():
            return [b"s", value.encode()]
        case bytes():
            return [b"y", value]
        case None:
            return [b"n"]
        case np.ndarray() if value.dtype.kind in "biu":
            shape = ",".join(map(str, value.shape)).encode()
            return [b"a", shape, value.astype("<i8").tobytes()]
        case dict():
            names = sorted(value)
            return [b"d", *_pieces(names), *(piece for name in names for piece in _pieces(value[name]))]
        case tuple() | list():
            count = str(len(value)).encode()
            return [b"t", count, *(piece for each in value for piece in _pieces(each))]
    raise GymError(
        f"an observation holds {type(value).__name__}: a table needs states it can meet again, "
        "so take an environment whose observations are whole numbers or text"
    )
