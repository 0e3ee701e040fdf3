"""Pictures by palette: every entity says its colours once, for all time, in every stream."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from services.monitor.rows import Arrow, Indexed, Moment, Picture
from services.monitor.writer import Writer, stream

PALETTE = np.array([(1, 2, 3), (250, 200, 60), (9, 9, 9)], np.uint8)
PIXELS = np.array([(0, 1, 2), (2, 1, 0)], np.uint8)


def written(path: Path, *pictures: Picture) -> Path:
    path.write_bytes(b"")
    recording = stream("test", 0.1, send_properties=False)
    recording.set_sinks(rr.FileSink(path, write_footer=True))
    writer = Writer(recording)
    for picture in pictures:
        writer.write(picture)
    recording.flush()
    recording.disconnect()
    return path


def values_of(path: Path, entity: str, component: str, *, static: bool) -> list[Any]:
    found: list[Any] = []
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        told = chunk.entity_path == f"/{entity}" and component in batch.schema.names
        if told and chunk.is_static is static:
            found += batch.column(component).to_pylist()
    return found


def colours_of(path: Path, entity: str) -> list[dict[int, tuple[int, ...]]]:
    told: list[Any] = values_of(path, entity, "AnnotationContext:context", static=True)
    return [{info["class_id"]: _rgba(info["class_description"]["info"]) for info in each} for (each,) in told]


def _rgba(info: dict[str, Any]) -> tuple[int, ...]:
    return tuple(info["color"].to_bytes(4, "big"))


def test_each_entity_says_its_own_colours_once_and_for_all_time(tmp_path: Path) -> None:
    world = Picture("world", Moment(0), Indexed(PIXELS, PALETTE))
    other = Picture("policy", Moment(1), Indexed(PIXELS, PALETTE[::-1].copy()))
    path = written(tmp_path / "a.rrd", world, other, replace(world, moment=Moment(2)))
    first = {number: (*map(int, rgb), 255) for number, rgb in enumerate(PALETTE)}
    last = {number: (*map(int, rgb), 255) for number, rgb in enumerate(PALETTE[::-1])}
    assert colours_of(path, "world") == [first]
    assert colours_of(path, "policy") == [last]
    assert values_of(path, "world", "AnnotationContext:context", static=False) == []
    # Another stream, as of a session that comes back, says them again.
    assert colours_of(written(tmp_path / "b.rrd", world), "world") == [first]


@pytest.mark.parametrize("image", [Indexed(PIXELS, PALETTE), b"\x89PNG\r\n\x1a\n"])
def test_a_picture_covers_all_and_lies_under_its_arrows(tmp_path: Path, image: Indexed | bytes) -> None:
    arrow = Arrow((1.0, 1.0), (1.0, 0.0), (9, 9, 9))
    path = written(tmp_path / "a.rrd", Picture("world", Moment(0), image, (arrow,)))
    name = "EncodedImage" if isinstance(image, bytes) else "SegmentationImage"
    assert values_of(path, "world", f"{name}:opacity", static=False) == [[1.0]]
    ((below,),) = values_of(path, "world", f"{name}:draw_order", static=False)
    ((above,),) = values_of(path, "world", "Arrows2D:draw_order", static=False)
    assert below < above
    if isinstance(image, bytes):
        assert values_of(path, "world", "EncodedImage:media_type", static=False) == [["image/png"]]
