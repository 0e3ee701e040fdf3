"""Chance as a function, many draws at once: bit for bit the draws of `sfid_core.chance`."""

from collections.abc import Iterable
from hashlib import blake2b

import numpy as np
import numpy.typing as npt

Words = npt.NDArray[np.uint64]

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)


def streams(seeds: Iterable[int], *names: str | int) -> Words:
    """Return `stream(seed, *names)` for every seed: uint64 [n_seeds]."""
    tail = "".join([f"\x1f{name}" for name in names])
    digests = [blake2b(f"{seed}{tail}".encode(), digest_size=8).digest() for seed in seeds]
    return np.frombuffer(b"".join(digests), dtype="<u8").astype(np.uint64)


def draws(key: int | Words, counters: npt.ArrayLike) -> Words:
    """Return `draw(key, counter)` for every counter.

    Args: key: one stream's key, or an array of keys; counters: ints of 0 or more. The two broadcast.
    Returns: uint64 of the broadcast shape.
    """
    positions = np.asarray(counters).astype(np.uint64)
    # Arrays wrap around at 2**64 in silence, as the generator wants; scalars would warn.
    z = np.atleast_1d(positions + np.uint64(1))
    z = z * _GOLDEN + np.asarray(key, dtype=np.uint64)
    z = (z ^ (z >> np.uint64(30))) * _MIX_1
    z = (z ^ (z >> np.uint64(27))) * _MIX_2
    shape = np.broadcast_shapes(np.shape(key), positions.shape)
    mixed: Words = z ^ (z >> np.uint64(31))
    return mixed.reshape(shape)


def belows(key: int | Words, counters: npt.ArrayLike, n: int) -> npt.NDArray[np.int64]:
    """Return `below(key, counter, n)` for every counter: uniform ints in [0, n), for n from 1 to 2**32."""
    return (((draws(key, counters) >> np.uint64(32)) * np.uint64(n)) >> np.uint64(32)).astype(np.int64)


def units(key: int | Words, counters: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return `unit(key, counter)` for every counter: uniform float64 in [0, 1) with 53 random bits."""
    return (draws(key, counters) >> np.uint64(11)).astype(np.float64) * 2.0**-53
