"""Chance as a function: every draw is named by a key and a counter, never by the order of calls.

The generator is SplitMix64 (Steele, Lea & Flood 2014) read at position `counter` of the stream `key`. A draw
for one decision is therefore the same in a live session, in its replay and in a batch run, whatever else was
drawn before it.
"""

from hashlib import blake2b

_MASK = (1 << 64) - 1
_GOLDEN = 0x9E3779B97F4A7C15
"""2**64 divided by the golden ratio: SplitMix64's increment."""


def stream(seed: int, *names: str | int) -> int:
    """Return the key of the stream that belongs to these names under this seed.

    Args: seed: the run's seed, any int of at most 64 bits; names: role, session and so on, in a fixed order.
    Returns: an int in [0, 2**64).
    """
    text = "\x1f".join(str(part) for part in (seed, *names))
    return int.from_bytes(blake2b(text.encode(), digest_size=8).digest(), "little")


def draw(key: int, counter: int) -> int:
    """Return 64 random bits: position `counter` (0 or more) of the stream `key`."""
    z = (key + (counter + 1) * _GOLDEN) & _MASK
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
    return z ^ (z >> 31)


def below(key: int, counter: int, n: int) -> int:
    """Return a uniform int in [0, n), for n from 1 to 2**32.

    The upper 32 bits are scaled by a multiplication; the bias is below n / 2**32, far under what an
    experiment sees.
    """
    return ((draw(key, counter) >> 32) * n) >> 32


def unit(key: int, counter: int) -> float:
    """Return a uniform float64 in [0, 1) with 53 random bits."""
    return (draw(key, counter) >> 11) * 2.0**-53
