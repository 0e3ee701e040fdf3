"""Rows into a Rerun stream: the one place that knows how a row is logged."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from services.monitor import curves
from services.monitor.rows import Arrow, Curves, Events, Lane, Moment, Picture, Row, Status

APPLICATION = "sfid"
LINES: dict[str, tuple[tuple[tuple[int, ...], ...], tuple[float, ...]]] = {
    curves.STEPS: (((120, 190, 255, 110), (120, 190, 255, 255), (150, 150, 150, 220)), (1.0, 2.5, 1.5)),
    curves.TD_ERROR: (((255, 150, 70, 255), (255, 205, 120, 150)), (2.0, 1.5)),
    curves.RETURN: (((110, 220, 150, 255), (150, 165, 190, 220)), (2.0, 1.5)),
    curves.INPUTS: (((200, 150, 255, 255),), (2.0,)),
    curves.AGREEMENT: (((70, 210, 200, 255),), (2.0,)),
}
"""Colours and widths of the curves, by entity; the names are in `curves.SERIES`."""
LANE_STATES = {
    "LEFT": ("←", (96, 165, 250)),
    "RIGHT": ("→", (250, 190, 60)),
    "UP": ("↑", (240, 120, 190)),
    "DOWN": ("↓", (80, 210, 130)),
}


def stream(recording_id: str, tick_s: float, *, send_properties: bool) -> rr.RecordingStream:
    """Return a stream whose only timelines are ours; without a sink it keeps what it is given."""
    batcher = rr.ChunkBatcherConfig(flush_tick=tick_s)
    recording = rr.RecordingStream(
        APPLICATION, recording_id=recording_id, send_properties=send_properties, batcher_config=batcher
    )
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    return recording


class Writer:
    """Writes rows to one stream; used by one thread, because Rerun's time is set by thread."""

    __slots__ = ("_lanes", "_stream")

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._lanes: set[str] = set()

    def style_curves(self) -> None:
        """Give the curves their names and colours."""
        for entity, names in curves.SERIES.items():
            colours, widths = LINES[entity]
            steps = rr.components.InterpolationMode.StepAfter if entity == curves.INPUTS else None
            lines = rr.SeriesLines(names=names, colors=colours, widths=widths, interpolation_mode=steps)
            self._stream.log(entity, lines, static=True)

    def write(self, row: Row) -> None:
        """Log one row."""
        match row:
            case Picture():
                self._picture(row)
            case Curves():
                width = row.values.shape[1]
                scalars = rr.Scalars.columns(scalars=row.values.reshape(-1))
                partitioned = scalars.partition([width] * len(row.moments))
                self._stream.send_columns(row.entity, _timelines(row.moments), partitioned)
            case Lane():
                self._lane(row)
            case Events():
                lines = rr.TextLog.columns(text=row.texts, level=row.levels)
                self._stream.send_columns("events", _timelines(row.moments), lines)
            case Status():
                self._at(row.moment)
                self._stream.log("now", rr.TextDocument(row.markdown, media_type="text/markdown"))

    def _picture(self, row: Picture) -> None:
        self._at(row.moment)
        image = rr.EncodedImage(contents=row.png, media_type="image/png", draw_order=-10.0, opacity=1.0)
        self._stream.log(row.entity, image, _arrows(row.arrows))

    def _lane(self, row: Lane) -> None:
        entity = f"teachers/{row.teacher}"
        if row.teacher not in self._lanes:
            self._lanes.add(row.teacher)
            signs, colours = zip(*LANE_STATES.values(), strict=True)
            states = rr.StateConfiguration(values=list(LANE_STATES), labels=signs, colors=colours)
            self._stream.log(entity, states, static=True)
        self._stream.send_columns(entity, _timelines(row.moments), rr.StateChange.columns(state=row.states))

    def _at(self, moment: Moment) -> None:
        self._stream.reset_time()
        self._stream.set_time("decision", sequence=moment.decision)
        self._stream.set_time("wall", timestamp=np.datetime64(moment.wall_ns, "ns"))


def _arrows(arrows: Sequence[Arrow]) -> rr.Arrows2D:
    """All arrows of a picture; none is an empty batch, which clears those before."""
    labels = [arrow.label for arrow in arrows]
    return rr.Arrows2D(
        origins=np.array([arrow.origin for arrow in arrows], np.float32).reshape(-1, 2),
        vectors=np.array([arrow.vector for arrow in arrows], np.float32).reshape(-1, 2),
        radii=[arrow.width / 2 for arrow in arrows],
        colors=[(*arrow.colour, round(arrow.opacity * 255)) for arrow in arrows],
        labels=labels,
        show_labels=any(labels),
        draw_order=10.0,
    )


def _timelines(moments: Sequence[Moment]) -> list[Any]:
    """The three timelines of some rows; `episode` only where every row stands for one."""
    timelines = [
        rr.TimeColumn("decision", sequence=[moment.decision for moment in moments]),
        rr.TimeColumn("wall", timestamp=np.array([moment.wall_ns for moment in moments], "datetime64[ns]")),
    ]
    episodes = [moment.episode for moment in moments if moment.episode is not None]
    if len(episodes) == len(moments):
        timelines.append(rr.TimeColumn("episode", sequence=episodes))
    return timelines
