"""When a viewer that came late had what, told by its file: the first bytes up to each moment are read."""

import bisect
from collections.abc import Callable, Sequence
from functools import cache

STREAM_HEADER, FRAME_HEADER = 12, 16
"""Bytes before the first frame of an .rrd, and before each frame: its kind and its length, eight each."""


def frame_ends(saved: bytes) -> list[int]:
    """Return where each whole frame of a recording ends; a file that is still written may end within one."""
    ends, at = [], STREAM_HEADER
    while at + FRAME_HEADER <= len(saved):
        at += FRAME_HEADER + int.from_bytes(saved[at + 8 : at + 16], "little")
        if at > len(saved):
            break
        ends.append(at)
    return ends


def reached(
    sizes: Sequence[tuple[float, int]], saved: bytes, count: Callable[[bytes], int], wanted: Sequence[int]
) -> list[float | None]:
    """Return when the file held so many of what `count` counts; None where that was not seen.

    Args: sizes: the file's size at each moment, in s, rising; saved: the file at the end; count: of a file of
    whole frames, never falling as it grows; wanted: how many, each at least 1.
    """
    ends = frame_ends(saved)

    @cache
    def counted(size: int) -> int:
        whole = bisect.bisect_right(ends, size)
        return count(saved[: ends[whole - 1]]) if whole else 0

    found = [bisect.bisect_left(sizes, many, key=lambda moment: counted(moment[1])) for many in wanted]
    return [sizes[at][0] if at < len(sizes) else None for at in found]
