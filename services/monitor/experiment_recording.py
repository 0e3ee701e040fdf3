"""An experiment's curves as a recording: a plot a measure, a line an arm, its interval as two thin lines."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
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


class Course(NamedTuple):
    """A line of a recording with its interval; `at`, `mean`, `lo` and `hi` have one length."""

    plot: str
    name: str
    at: npt.NDArray[np.int64]
    mean: npt.NDArray[np.float64]
    lo: npt.NDArray[np.float64]
    hi: npt.NDArray[np.float64]


def record_curves(path: Path, summaries: Sequence[ArmSummary]) -> Path:
    """Write the four measures by episode, every arm with its interval, over a file of that name.

    Episodes count from 1, as people do.  Raises: MonitorError when the file cannot be written.
    """
    courses = [
        Course(
            title,
            f"{summary.method}, {summary.teacher}",
            np.arange(1, len(summary.means[measure]) + 1),
            summary.means[measure],
            summary.intervals[measure][:, 0],
            summary.intervals[measure][:, 1],
        )
        for summary in summaries
        for measure, title in TITLES.items()
    ]
    return record_courses(path, courses, "episode")


def record_courses(path: Path, courses: Sequence[Course], index: str) -> Path:
    """Write a plot for each `plot` among the courses, a colour a name, over a file of that name.

    Args: index: what `at` counts.  Raises: MonitorError when the file cannot be written.
    """
    try:
        path.unlink(missing_ok=True)
        stream = rr.RecordingStream("sfid_experiment", send_properties=True)
        stream.set_sinks(rr.FileSink(path, write_footer=True))
    except OSError as error:
        reason = error.strerror or str(error)
        raise MonitorError(f"cannot write {path}: {reason}; give a folder you may write to") from None
    plots = list(dict.fromkeys(course.plot for course in courses))
    names = list(dict.fromkeys(course.name for course in courses))
    views = [rrb.TimeSeriesView(name=plot, origin=f"/{place_of(plot)}") for plot in plots]
    stream.send_blueprint(rrb.Blueprint(rrb.Grid(*views, grid_columns=2), collapse_panels=True))
    for course in courses:
        _draw(stream, course, COLOURS[names.index(course.name) % len(COLOURS)], index)
    stream.flush()
    stream.disconnect()
    return path


def place_of(name: str) -> str:
    """Return a name as part of an entity's path: letters, digits and _ alone."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_").lower()


def _draw(stream: rr.RecordingStream, course: Course, colour: tuple[int, int, int], index: str) -> None:
    """Write one line and the two edges of its interval."""
    lines = {
        "mean": (course.mean, course.name, 2.0, 255),
        "lo": (course.lo, "", 0.75, 110),
        "hi": (course.hi, "", 0.75, 110),
    }
    for part, (values, name, width, alpha) in lines.items():
        place = f"/{place_of(course.plot)}/{place_of(course.name)}/{part}"
        stream.log(
            place,
            rr.SeriesLines(colors=[(*colour, alpha)], names=[name or part], widths=[width]),
            static=True,
        )
        stream.send_columns(
            place,
            indexes=[rr.TimeColumn(index, sequence=course.at)],
            columns=rr.Scalars.columns(scalars=np.asarray(values)),
        )
