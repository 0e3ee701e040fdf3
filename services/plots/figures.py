"""The door to all figures: what to call, and the one line that says what is missing without matplotlib."""

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from services.plots.model import Floats, Grid, Line, Panel, PlotError, Width
from sfid_core.experiments.summary import ArmSummary, Measure

NAMES = {"sfid": "SfID", "reward": "Reward shaping", "q-learning": "Q-learning"}
"""How methods are written in figures; others are written as they are called."""

FIGURE2_PANELS = (
    (Measure.ABS_TD_ERROR, "(a) |TD error|", True),
    (Measure.STEPS, "(b) Steps", True),
    (Measure.DISCOUNTED_RETURN, "(c) Discounted return", False),
    (Measure.INPUTS, "(d) Inputs", True),
)
"""The founding paper's Figure 2: measure, title, and whether the axis starts at 0."""


def require_matplotlib() -> None:
    """Raise PlotError with the mend where matplotlib is not installed; call it before a long run."""
    try:
        importlib.import_module("matplotlib")
    except ImportError as error:
        raise PlotError(
            "figures need matplotlib, which is not installed: pip install 'sfid[plots]', or leave them out"
        ) from error


def write_figure2(
    summaries: Sequence[ArmSummary],
    stem: Path,
    optimum: Mapping[Measure, Floats | float] | None = None,
    width: Width = Width.COLUMN,
    level: float = 0.95,
) -> tuple[Path, Path]:
    """Write the paper's 2 x 2 figure as PNG and SVG: the four measures by episode, a line an arm.

    Args: summaries: a colour a method, a line style a teacher, in the order of their appearance; stem: the
    path without an ending; optimum: the best that can be reached, for every episode or for all, where it is
    known; level: coverage of the intervals.  Raises: PlotError.
    """
    lines = {measure: curve_lines(summaries, measure) for measure, _, _ in FIGURE2_PANELS}
    panels = [
        Panel(title, lines[measure], optimum=(optimum or {}).get(measure), from_zero=from_zero)
        for measure, title, from_zero in FIGURE2_PANELS
    ]
    seeds = max((summary.n_seeds for summary in summaries), default=0)
    return write_curves(panels, stem, f"Means over {seeds:,} seeds; bands: {level:.0%} intervals.", width)


def curve_lines(summaries: Sequence[ArmSummary], measure: Measure) -> tuple[Line, ...]:
    """Return a line for each arm that has the measure; episodes count from 1, as people do."""
    methods = list(dict.fromkeys(summary.method for summary in summaries))
    teachers = list(dict.fromkeys(summary.teacher for summary in summaries))
    return tuple(
        Line(
            f"{NAMES.get(summary.method, summary.method)}, {summary.teacher}",
            np.arange(1.0, len(summary.means[measure]) + 1),
            summary.means[measure],
            summary.intervals[measure][:, 0],
            summary.intervals[measure][:, 1],
            methods.index(summary.method),
            teachers.index(summary.teacher),
        )
        for summary in summaries
        if measure in summary.means
    )


def total_grid(summaries: Sequence[ArmSummary], total: str, title: str) -> Grid:
    """Return a total of every arm as a grid, methods by teachers; what was not run stays empty."""
    methods = list(dict.fromkeys(summary.method for summary in summaries))
    teachers = list(dict.fromkeys(summary.teacher for summary in summaries))
    cells = np.full((3, len(methods), len(teachers)), np.nan)
    for summary in summaries:
        if total in summary.totals:
            mean, (lo, hi) = summary.totals[total]
            cells[:, methods.index(summary.method), teachers.index(summary.teacher)] = mean, lo, hi
    rows = tuple(NAMES.get(method, method) for method in methods)
    return Grid(title, rows, tuple(teachers), cells[0], cells[1], cells[2])


def write_curves(
    panels: Sequence[Panel], stem: Path, note: str = "", width: Width = Width.COLUMN
) -> tuple[Path, Path]:
    """Write curves with interval bands, panels in two columns, as PNG and SVG.

    Args: stem: the path without an ending; note: one line below the panels.  Raises: PlotError.
    """
    require_matplotlib()
    from services.plots.curves import draw_curves  # noqa: PLC0415 - matplotlib is an extra
    from services.plots.save import save  # noqa: PLC0415 - as above

    shown = "; ".join(panel.title for panel in panels)
    return save(draw_curves(panels, note, width), stem, f"Curves with intervals: {shown}. {note}".strip())


def write_heat_table(
    grid: Grid,
    stem: Path,
    note: str = "",
    width: Width = Width.COLUMN,
    limits: tuple[float, float] = (0.0, 1.0),
) -> tuple[Path, Path]:
    """Write a table with coloured cells, each its value and interval, as PNG and SVG.

    Args: stem, note: as in `write_curves`; limits: the values at the two ends of the colour scale.
    Raises: PlotError.
    """
    require_matplotlib()
    from services.plots.heat_table import draw_heat_table  # noqa: PLC0415 - matplotlib is an extra
    from services.plots.save import save  # noqa: PLC0415 - as above

    figure = draw_heat_table(grid, note, width, limits)
    return save(figure, stem, f"Table with coloured cells: {grid.title}. {note}".strip())


def write_dots(
    panels: Sequence[Grid],
    stem: Path,
    note: str = "",
    width: Width = Width.PAGE,
    limits: tuple[float, float] | None = (0.0, 1.0),
) -> tuple[Path, Path]:
    """Write grouped dots with intervals, panels side by side on one scale, as PNG and SVG.

    Args: panels: their rows are the groups, their columns the series; stem, note: as in `write_curves`;
    limits: of the scale, None for what the intervals need.  Raises: PlotError.
    """
    require_matplotlib()
    from services.plots.dots import draw_dots  # noqa: PLC0415 - matplotlib is an extra
    from services.plots.save import save  # noqa: PLC0415 - as above

    shown = "; ".join(panel.title for panel in panels)
    figure = draw_dots(panels, note, width, limits)
    return save(figure, stem, f"Dots with intervals: {shown}. {note}".strip())
