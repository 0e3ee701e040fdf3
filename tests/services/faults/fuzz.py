"""Random and mutated frames of every message type: a message of the schema, or the one error class."""

import random
import resource
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from protocol.codec import DecodeError, decode, encode
from protocol.messages import Wire
from tests.protocol.samples import FULL

RANDOM_BYTES_MAX = 4_096
SHORT_BYTES = 64
"""Most random frames are short: there a message begins, if anywhere."""
EDITS_MAX = 6
EXAMPLES = {type(message): message for message in FULL}
"""One of each type."""


class Frames(NamedTuple):
    """What came of the frames."""

    frames: int
    types: int
    messages: int
    """Frames that were read as a message; each was the same message when it was written and read again."""
    refused: int
    foreign: dict[str, int]
    """Errors of another class than `DecodeError`."""
    unfaithful: int
    """Messages that were another when written and read again, or of another type than was asked for."""
    grown_mb: int
    """By how much the peak of the process's memory grew."""


def send_random(frames: int, seed: int) -> Frames:
    """Decode `frames` random frames as every type."""
    chance = random.Random(seed)

    def drawn(_: bytes) -> bytes:
        long = chance.random() < 0.02
        return chance.randbytes(chance.randrange(RANDOM_BYTES_MAX if long else SHORT_BYTES))

    return _sent(frames, drawn)


def send_mutated(frames: int, seed: int) -> Frames:
    """Decode `frames` mutants of a good frame of every type, each with 1 to 6 edits."""
    chance = random.Random(seed)

    def drawn(payload: bytes) -> bytes:
        mutant = bytearray(payload)
        for _ in range(1 + int(chance.random() ** 2 * EDITS_MAX)):
            _edit(mutant, chance)
        return bytes(mutant)

    return _sent(frames, drawn)


def _edit(mutant: bytearray, chance: random.Random) -> None:
    at, kind = int(chance.random() * len(mutant)), int(chance.random() * 5)
    if kind == 0 and mutant:
        mutant[at] ^= 1 << int(chance.random() * 8)
    elif kind == 1 and mutant:
        mutant[at] = int(chance.random() * 256)
    elif kind == 2:
        del mutant[at : at + 1 + int(chance.random() * 8)]
    elif kind == 3:
        mutant[at:at] = chance.randbytes(1 + int(chance.random() * 8))
    else:
        mutant[at:at] = mutant[at : at + 1 + int(chance.random() * 16)]


def _sent(frames: int, drawn: Callable[[bytes], bytes]) -> Frames:
    found: Counter[str] = Counter()
    foreign: Counter[str] = Counter()
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for kind, example in EXAMPLES.items():
        payload = encode(example)
        for _ in range(frames):
            mutant = drawn(payload)
            try:
                message = decode(mutant, kind)
            except DecodeError:
                found["refused"] += 1
            except Exception as error:  # noqa: BLE001 - which there must be none of
                foreign[type(error).__name__] += 1
            else:
                found["messages"] += 1
                found["unfaithful"] += not _faithful(message, kind)
    grown_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb) // 1024
    return Frames(
        frames * len(EXAMPLES), len(EXAMPLES), found["messages"], found["refused"], dict(foreign),
        found["unfaithful"], grown_mb,
    )  # fmt: skip


def _faithful(message: Wire, kind: type[Wire]) -> bool:
    return type(message) is kind and encode(decode(encode(message), kind)) == encode(message)
