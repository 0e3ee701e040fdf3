"""An experiment's curves as a recording: a plot a measure, a line an arm, its interval as two thin lines."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from services.monitor.config import MonitorError
from sfid_core.experiments.summary import ArmSummary, Measure

COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233))
"""Okabe & Ito 2008: told apart by colour-blind people too."""
TITLES = {
    Measure.ABS_TD_ERROR: "|TD error|",
    Measure.STEPS: "Steps",
    Measure.DISCOUNTED_RETURN: "Discounted return",
    Measure.INPUTS: "Teacher inputs",
}


def record_curves(path: Path, summaries: Sequence[ArmSummary]) -> Path:
    """Write the four measures by episode, every arm with its interval, over a file of that name.

    Raises: MonitorError when the file cannot be written.
    """
    try:
        path.unlink(missing_ok=True)
        stream = rr.RecordingStream("sfid_experiment", send_properties=True)
        stream.set_sinks(rr.FileSink(path, write_footer=True))
    except OSError as error:
        reason = error.strerror or str(error)
        raise MonitorError(f"cannot write {path}: {reason}; give a folder you may write to") from None
    views = [rrb.TimeSeriesView(name=title, origin=f"/{measure.value}") for measure, title in TITLES.items()]
    stream.send_blueprint(rrb.Blueprint(rrb.Grid(*views, grid_columns=2), collapse_panels=True))
    for number, summary in enumerate(summaries):
        colour = COLOURS[number % len(COLOURS)]
        for measure in TITLES:
            _draw(stream, summary, measure, colour)
    stream.flush()
    stream.disconnect()
    return path


def _draw(
    stream: rr.RecordingStream, summary: ArmSummary, measure: Measure, colour: tuple[int, int, int]
) -> None:
    """Write one line and the two edges of its interval; episodes count from 1, as people do."""
    mean, interval = summary.means[measure], summary.intervals[measure]
    lines = {
        "mean": (mean, f"{summary.method}, {summary.teacher}", 2.0, 255),
        "lo": (interval[:, 0], "", 0.75, 110),
        "hi": (interval[:, 1], "", 0.75, 110),
    }
    for part, (values, name, width, alpha) in lines.items():
        place = f"/{measure.value}/{summary.method}_{summary.teacher}/{part}"
        stream.log(
            place,
            rr.SeriesLines(colors=[(*colour, alpha)], names=[name or part], widths=[width]),
            static=True,
        )
        stream.send_columns(
            place,
            indexes=[rr.TimeColumn("episode", sequence=np.arange(1, len(values) + 1))],
            columns=rr.Scalars.columns(scalars=np.asarray(values)),
        )
