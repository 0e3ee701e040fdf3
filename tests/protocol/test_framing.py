"""Frames of the mirror log: whole or not at all."""

from __future__ import annotations

import io
import random

import pytest

from protocol.framing import (
    HEADER_BYTES,
    MAGIC,
    PAYLOAD_BYTES_MAX,
    Frame,
    frame,
    frames,
    is_torn_tail,
    whole_frames_within,
)

PAYLOADS = (b"first", b"", b"third " + bytes(300))
LOG = b"".join(map(frame, PAYLOADS))


def offsets() -> list[int]:
    at = [0]
    for payload in PAYLOADS:
        at.append(at[-1] + HEADER_BYTES + len(payload))
    return at


def test_frames_come_back_in_order_with_their_offsets() -> None:
    at = offsets()
    assert list(frames(io.BytesIO(LOG))) == [
        Frame(at[0], at[1], PAYLOADS[0]),
        Frame(at[1], at[2], PAYLOADS[1]),
        Frame(at[2], at[3], PAYLOADS[2]),
    ]


def test_a_frame_has_the_documented_bytes() -> None:
    # CRC-32 of 04 00 00 00 'l' 'o' 'g' '!', computed by hand with the polynomial 0xEDB88320.
    checksum = 0xFFFFFFFF
    for byte in b"\x04\x00\x00\x00log!":
        checksum ^= byte
        for _ in range(8):
            checksum = (checksum >> 1) ^ (0xEDB88320 if checksum & 1 else 0)
    checksum ^= 0xFFFFFFFF
    assert frame(b"log!") == MAGIC + b"\x04\x00\x00\x00" + checksum.to_bytes(4, "little") + b"log!"


def test_a_log_cut_at_any_byte_of_its_last_frame_keeps_the_others_and_is_torn() -> None:
    last = offsets()[2]
    for cut in range(last, len(LOG)):
        log = io.BytesIO(LOG[:cut])
        assert [one.payload for one in frames(log)] == list(PAYLOADS[:2])
        assert is_torn_tail(LOG[last:cut])


def test_any_single_bit_flip_loses_exactly_the_frame_it_is_in() -> None:
    ends = offsets()[1:]
    for bit in range(len(LOG) * 8):
        damaged = bytearray(LOG)
        damaged[bit // 8] ^= 1 << (bit % 8)
        hit = next(index for index, end in enumerate(ends) if bit // 8 < end)
        survivors = [payload for index, payload in enumerate(PAYLOADS) if index != hit]
        assert [one.payload for one in whole_frames_within(bytes(damaged))] == survivors
        assert [one.payload for one in frames(io.BytesIO(bytes(damaged)))] == list(PAYLOADS[:hit])


def test_a_break_with_a_whole_frame_behind_it_is_damage_not_a_torn_tail() -> None:
    assert is_torn_tail(b"")
    assert is_torn_tail(bytes(4096))
    assert is_torn_tail(frame(b"half")[:-1])
    assert not is_torn_tail(b"x" + frame(b"whole"))
    assert not is_torn_tail(frame(b"half")[:-1] + frame(b"whole"))


def test_zeroed_blocks_and_impossible_lengths_begin_no_frame() -> None:
    assert list(frames(io.BytesIO(bytes(4096)))) == []
    too_long = MAGIC + (PAYLOAD_BYTES_MAX + 1).to_bytes(4, "little") + bytes(4)
    assert list(frames(io.BytesIO(too_long + bytes(100)))) == []


def test_random_bytes_never_raise_and_never_pass_for_a_frame() -> None:
    rng = random.Random(7)
    for _ in range(2000):
        noise = MAGIC + rng.randbytes(rng.randrange(64))
        assert list(frames(io.BytesIO(noise))) == []
        assert list(whole_frames_within(noise)) == []


def test_a_payload_beyond_the_limit_is_refused() -> None:
    with pytest.raises(ValueError, match="at most"):
        frame(bytes(PAYLOAD_BYTES_MAX + 1))
