"""The figure of the benchmark about a viewer that comes late: nothing is told that was not seen."""

import struct
from collections.abc import Sequence
from pathlib import Path

import pytest

from services.monitor.rows import Document, Moment
from services.monitor.writer import Writer, stream
from tests.benchmarks.late_viewer import STREAM_HEADER, frame_ends, reached
from tests.services.monitor.rrd_rows import rows_of


def file_of(*lengths: int) -> bytes:
    frames = (struct.pack("<QQ", 2, length) + b"x" * length for length in lengths)
    return b"h" * STREAM_HEADER + b"".join(frames)


def frames_in(saved: bytes) -> int:
    ends = frame_ends(saved)
    assert ends == [] or ends[-1] == len(saved), "what is counted ends with a frame"
    return len(ends)


def moments(saved: bytes, sizes: Sequence[int], *wanted: int) -> list[float | None]:
    return reached([(float(at), size) for at, size in enumerate(sizes)], saved, frames_in, wanted)


def test_frames_end_where_their_lengths_say_and_one_that_is_cut_is_not_whole() -> None:
    saved = file_of(4, 0, 100)
    assert frame_ends(saved) == [32, 48, 164]
    assert frame_ends(saved[:-1]) == [32, 48]
    assert frame_ends(saved[:40]) == [32]
    assert frame_ends(saved[:5]) == frame_ends(b"") == []


def test_a_moment_at_which_a_frame_was_half_written_counts_those_before_it() -> None:
    saved = file_of(4, 4, 4, 4)
    assert moments(saved, (0, 40, 60, 80, 92), 1, 2, 3, 4) == [1.0, 2.0, 3.0, 4.0]
    assert moments(saved, (0, 20, 31, 33, 91), 1, 3, 4) == [3.0, 4.0, None]


def test_what_did_not_come_while_it_was_watched_has_no_moment() -> None:
    assert moments(file_of(4, 4), (0, 32, 52), 2, 3) == [2.0, None]
    assert moments(b"", (0,), 1) == [None]


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_every_part_of_a_recording_that_ends_with_a_frame_can_be_read(tmp_path: Path) -> None:
    path, part = tmp_path / "whole.rrd", tmp_path / "part.rrd"
    recording = stream("test", 0.0, send_properties=False)
    recording.save(path)
    writer = Writer(recording)
    for number in range(5):
        writer.write(Document("now", Moment(number), f"step {number}"))
        recording.flush()
    recording.disconnect()
    saved, counts = path.read_bytes(), []
    for end in frame_ends(saved):
        part.write_bytes(saved[:end])
        counts.append(len(rows_of(part, "now", "TextDocument:text")))
    assert counts == sorted(counts)
    assert set(counts) == {0, 1, 2, 3, 4, 5}
