"""Curves with interval bands, panels in two columns."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from services.plots.model import Line, Panel, PlotError, Width
from services.plots.style import INK, MUTED, SETTINGS, look

ROW_IN = 1.32
LEGEND_ROW_IN = 0.15
MARKED = 6
"""Markers on a line: enough to tell it, few enough to see its course."""


def draw_curves(panels: Sequence[Panel], note: str, width: Width) -> Figure:
    """Return the panels in two columns (one panel alone fills the width), one legend above, a note below."""
    if any(panel.optimum is not None for panel in panels):
        # In the note it stands in no curve's way.
        note = f"{note} Dotted: the optimum.".strip()
    if not panels:
        raise PlotError("a figure needs at least one panel")
    n_columns = min(2, len(panels))
    n_rows = -(-len(panels) // n_columns)
    lines = _distinct(panels)
    legend_columns = min(len(lines), 2 if width is Width.COLUMN else 4)
    head = LEGEND_ROW_IN * -(-len(lines) // max(1, legend_columns)) + 0.05
    foot = 0.17 if note else 0.0
    height = n_rows * ROW_IN * (1.0 if width is Width.COLUMN else 1.35) + head + foot
    with rc_context(SETTINGS):
        layout = ConstrainedLayoutEngine(
            rect=(0, foot / height, 1, 1 - (head + foot) / height),
            w_pad=0.03,
            h_pad=0.03,
            wspace=0.03,
            hspace=0.05,
        )
        figure = Figure(figsize=(width.value, height), layout=layout)
        grid = figure.subplots(n_rows, n_columns, squeeze=False)
        for place, axes in enumerate(grid.flat):
            if place < len(panels):
                _draw_panel(axes, panels[place], last_row=place >= len(panels) - n_columns)
            else:
                axes.set_axis_off()
        handles = [_handle(line) for line in lines]
        figure.legend(handles=handles, loc="upper center", ncols=max(1, legend_columns), borderaxespad=0.2)
        figure.text(0.5, 0.035 / height, note, ha="center", va="bottom", fontsize=6, color=MUTED)
    return figure


def _distinct(panels: Sequence[Panel]) -> list[Line]:
    """Return one line for each label, in the order in which they first appear."""
    distinct: dict[str, Line] = {}
    for panel in panels:
        for line in panel.lines:
            distinct.setdefault(line.label, line)
    return list(distinct.values())


def _handle(line: Line) -> Line2D:
    style = look(line.hue, line.dash)
    return Line2D(
        [],
        [],
        color=style.color,
        linestyle=style.dash,
        linewidth=style.width,
        marker=style.marker,
        markersize=3,
        markeredgecolor="white",
        markeredgewidth=0.4,
        label=line.label,
    )


def _draw_panel(axes: Axes, panel: Panel, *, last_row: bool) -> None:
    for order, line in enumerate(panel.lines):
        _draw_line(axes, line, order, len(panel.lines))
    axes.set_title(panel.title)
    if last_row:
        axes.set_xlabel(panel.x_label, labelpad=1.5)
    x = np.concatenate([line.x for line in panel.lines]) if panel.lines else np.array([0.0, 1.0])
    room = 0.025 * (np.ptp(x) or 1.0)
    axes.set_xlim(x.min() - room, x.max() + room)
    axes.xaxis.set_major_locator(MaxNLocator(4, integer=True, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    if panel.optimum is not None:
        _draw_optimum(axes, panel)
    if panel.from_zero:
        axes.set_ylim(bottom=0)


def _draw_line(axes: Axes, line: Line, order: int, n_lines: int) -> None:
    style = look(line.hue, line.dash)
    axes.fill_between(
        line.x, line.lo, line.hi, color=style.color, alpha=0.2, linewidth=0, zorder=style.above - 1
    )
    every = max(1, len(line.x) // MARKED)
    axes.plot(
        line.x,
        line.mean,
        color=style.color,
        linestyle=style.dash,
        linewidth=style.width,
        zorder=style.above,
        marker=style.marker,
        markersize=3,
        markeredgecolor="white",
        markeredgewidth=0.4,
        # Lines start their markers at different places, so that equal curves show both signs.
        markevery=(min(order * every // max(1, n_lines), len(line.x) - 1), every),
        solid_capstyle="round",
    )


def _draw_optimum(axes: Axes, panel: Panel) -> None:
    x = panel.lines[0].x if panel.lines else np.array([0.0, 1.0])
    level = np.broadcast_to(np.asarray(panel.optimum, dtype=np.float64), x.shape)
    axes.plot(x, level, color=INK, linewidth=1.0, linestyle=(0, (1, 1.4)), zorder=2.5)
