"""Grouped dots with intervals: where bars would be drawn, with the eye on the differences.

A bar's length is read from 0 and hides its interval; a dot on a common scale is read exactly (Cleveland &
McGill 1984), and many groups fit below each other.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from services.plots.model import Grid, PlotError, Width
from services.plots.style import FAINT, HUES, MARKERS, MUTED, SETTINGS

ROW_IN = 0.165
LINE_IN = 0.055
"""What each further series adds to a row."""


def draw_dots(panels: Sequence[Grid], note: str, width: Width, limits: tuple[float, float] | None) -> Figure:
    """Return panels side by side on one scale: a row a group, a colour and marker a series.

    Args: panels: their `rows` are the groups and their `columns` the series, the same in all of them;
    limits: of the common scale, None for what the intervals need.
    """
    if not panels or len({(panel.rows, panel.columns) for panel in panels}) != 1:
        raise PlotError("dots need one panel or more, all with the same rows and columns")
    n_rows, n_series = len(panels[0].rows), len(panels[0].columns)
    body = n_rows * (ROW_IN + LINE_IN * (n_series - 1))
    head, foot = (0.22 if n_series > 1 else 0.02), (0.17 if note else 0.0)
    height = body + head + foot + 0.5
    with rc_context(SETTINGS):
        layout = ConstrainedLayoutEngine(
            rect=(0, foot / height, 1, 1 - (head + foot) / height), w_pad=0.03, h_pad=0.02, wspace=0.03
        )
        figure = Figure(figsize=(width.value, height), layout=layout)
        grid = figure.subplots(1, len(panels), squeeze=False, sharex=True, sharey=True)
        for axes, panel in zip(grid.flat, panels, strict=True):
            _draw_panel(axes, panel)
        first = grid.flat[0]
        first.set_ylim(n_rows - 0.5, -0.5)
        first.set_yticks(range(n_rows), panels[0].rows)
        if limits is not None:
            room = 0.03 * (limits[1] - limits[0])
            first.set_xlim(limits[0] - room, limits[1] + room)
        if n_series > 1:
            handles, labels = first.get_legend_handles_labels()
            figure.legend(
                handles, labels, loc="upper center", ncols=n_series, borderaxespad=0.2, handlelength=1
            )
        figure.text(0.5, 0.035 / height, note, ha="center", va="bottom", fontsize=6, color=MUTED)
    return figure


def _draw_panel(axes: Axes, panel: Grid) -> None:
    n_rows, n_series = len(panel.rows), len(panel.columns)
    for row in range(1, n_rows, 2):
        axes.axhspan(row - 0.5, row + 0.5, color=FAINT, alpha=0.45, linewidth=0, zorder=0)
    step = 0.62 / max(1, n_series)
    for series, name in enumerate(panel.columns):
        color = HUES[series % len(HUES)]
        y = np.arange(n_rows) + (series - (n_series - 1) / 2) * step
        axes.hlines(y, panel.lo[:, series], panel.hi[:, series], color=color, linewidth=1.1, zorder=2)
        axes.plot(
            panel.values[:, series],
            y,
            color=color,
            linestyle="none",
            marker=MARKERS[series % len(MARKERS)],
            markersize=3.2,
            markeredgecolor="white",
            markeredgewidth=0.4,
            label=name,
            zorder=3,
        )
    axes.set_title(panel.title)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.locator_params(axis="x", nbins=4)
