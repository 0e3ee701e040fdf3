"""Rows into a Rerun stream: the one place that knows how a row is logged."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any

import numpy as np
import rerun as rr

from services.monitor import curves
from services.monitor.rows import (
    Arrow,
    Colour,
    Curves,
    Document,
    Events,
    Lane,
    Moment,
    Picture,
    Reliabilities,
    Row,
)
from services.monitor.status import SIGNS
from sfid_core.teaching.merge import ACTIONS_MAX

APPLICATION = "sfid"
LINES: dict[str, tuple[tuple[tuple[int, ...], ...], tuple[float, ...]]] = {
    curves.STEPS: (((120, 190, 255, 110), (120, 190, 255, 255), (150, 150, 150, 220)), (1.0, 2.5, 1.5)),
    curves.TD_ERROR: (((255, 150, 70, 255), (255, 205, 120, 150)), (2.0, 1.5)),
    curves.RETURN: (((110, 220, 150, 255), (150, 165, 190, 220)), (2.0, 1.5)),
    curves.INPUTS: (((200, 150, 255, 255),), (2.0,)),
    curves.AGREEMENT: (((70, 210, 200, 255),), (2.0,)),
}
"""Colours and widths of the curves, by entity; the names are in `curves.SERIES`."""
AGREED_COLOUR: Colour = (70, 210, 200)
DIFFERED_COLOUR: Colour = (120, 112, 104)
"""Of what a teacher said, by what the agent did: the colour of the curve of agreement, and grey. The colours
of teachers would be taken for teachers."""

NamedActions = dict[str, dict[str, None]]
"""Of each lane the actions that its states are about."""


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
    """Writes rows to one stream; used by one thread, because Rerun's time is set by thread.

    Args: actions: shared by the writers of one recording, because a viewer believes whoever spoke last.
    """

    __slots__ = ("_actions", "_legends", "_painted", "_stream", "_styled")

    def __init__(self, stream: rr.RecordingStream, actions: NamedActions | None = None) -> None:
        self._stream = stream
        self._actions: NamedActions = {} if actions is None else actions
        self._styled: dict[str, int] = {}
        """Of each lane how many actions this stream has been told the signs of."""
        self._legends: dict[str, str] = {}
        self._painted: set[str] = set()

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
                for part in _alike(row.moments):
                    scalars = rr.Scalars.columns(scalars=row.values[part].reshape(-1))
                    self._columns(row.entity, row.moments[part], scalars.partition([width] * _length(part)))
            case Lane():
                self._lane(row)
            case Reliabilities():
                self._reliabilities(row)
            case Events():
                for part in _alike(row.moments):
                    lines = rr.TextLog.columns(text=row.texts[part], level=row.levels[part])
                    self._columns("events", row.moments[part], lines)
            case Document():
                self._at(row.moment)
                self._stream.log(row.entity, rr.TextDocument(row.markdown, media_type="text/markdown"))

    def _columns(self, entity: str, moments: Sequence[Moment], columns: Any) -> None:  # noqa: ANN401 - Rerun's list
        self._stream.send_columns(entity, _timelines(moments), columns)

    def _reliabilities(self, row: Reliabilities) -> None:
        entity = f"reliability/{row.teacher}"
        if self._legends.get(entity) != row.label:
            self._legends[entity] = row.label
            style = rr.Measurements.from_fields(colors=[row.colour], names=[row.label], widths=[2.0])
            self._stream.log(entity, style, static=True)
        for part in _alike(row.moments):
            variances = np.array(row.errors[part]) ** 2
            columns = rr.Measurements.columns(values=np.array(row.means[part]), variances=variances)
            self._columns(entity, row.moments[part], columns)

    def _picture(self, row: Picture) -> None:
        self._at(row.moment)
        self._stream.log(row.entity, self._image(row), _arrows(row.arrows))
        for lane in row.lanes:
            self._lane(lane)

    def _image(self, row: Picture) -> rr.SegmentationImage | rr.EncodedImage:
        if isinstance(row.image, bytes):
            return rr.EncodedImage(contents=row.image, media_type="image/png", draw_order=-10.0, opacity=1.0)
        if row.entity not in self._painted:
            self._painted.add(row.entity)
            colours = [rr.AnnotationInfo(index, color=rgb) for index, rgb in enumerate(row.image.palette)]
            self._stream.log(row.entity, rr.AnnotationContext(colours), static=True)
        return rr.SegmentationImage(row.image.indexes, draw_order=-10.0, opacity=1.0)

    def _lane(self, row: Lane) -> None:
        entity = f"teachers/{row.teacher}"
        known = self._actions.setdefault(row.teacher, dict.fromkeys(SIGNS))
        # A world of other actions tells their names as they come.
        for state in row.states:
            if state and len(known) < ACTIONS_MAX:
                known.setdefault(state.removesuffix(curves.DIFFERED))
        if self._styled.get(row.teacher) != len(known):
            self._styled[row.teacher] = len(known)
            self._stream.log(entity, _lane_states(known), static=True)
        for part in _alike(row.moments):
            self._columns(entity, row.moments[part], rr.StateChange.columns(state=row.states[part]))

    def _at(self, moment: Moment) -> None:
        self._stream.reset_time()
        self._stream.set_time("step", sequence=moment.step)
        if moment.episode is not None:
            self._stream.set_time("episode", sequence=moment.episode)
        if moment.wall_ns is not None:
            self._stream.set_time("wall", timestamp=np.datetime64(moment.wall_ns, "ns"))


def _alike(moments: Sequence[Moment]) -> Iterator[slice]:
    """Yield the stretches of rows that are on the same timelines: a column has no gaps."""
    start = 0
    for _, group in groupby(moments, lambda moment: (moment.wall_ns is None, moment.episode is None)):
        length = sum(1 for _ in group)
        yield slice(start, start + length)
        start += length


def _lane_states(actions: Iterable[str]) -> rr.StateConfiguration:
    """How the states of a lane are written, and their colours."""
    states = [
        (action + end, SIGNS.get(action, action), colour)
        for action in actions
        for end, colour in (("", AGREED_COLOUR), (curves.DIFFERED, DIFFERED_COLOUR))
    ]
    values, signs, colours = zip(*states, strict=True)
    return rr.StateConfiguration(values=values, labels=signs, colors=colours)


def _length(part: slice) -> int:
    return int(part.stop) - int(part.start)


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
    """The timelines of some rows, which are on the same ones."""
    timelines = [rr.TimeColumn("step", sequence=[moment.step for moment in moments])]
    walls = [moment.wall_ns for moment in moments if moment.wall_ns is not None]
    if walls:
        timelines.append(rr.TimeColumn("wall", timestamp=np.array(walls, "datetime64[ns]")))
    episodes = [moment.episode for moment in moments if moment.episode is not None]
    if episodes:
        timelines.append(rr.TimeColumn("episode", sequence=episodes))
    return timelines
