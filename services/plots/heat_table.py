"""A table whose cells are coloured by their value: methods by teachers, with intervals."""

import math
import re
from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from services.plots.model import Grid, PlotError, Width
from services.plots.style import MUTED, SETTINGS

CELL_IN = 0.21
CHARACTER_IN = 0.063
"""Width of a letter of the row names; names are set beside the cells."""
SCALE = LinearSegmentedColormap.from_list("sfid", ["#f7fbff", "#d6e6f4", "#9ecae1", "#6baed6", "#4292c6"])
"""One hue from light to middling: read alike with any colour vision and in grey, under black letters."""


def draw_heat_table(grid: Grid, note: str, width: Width, limits: tuple[float, float] = (0.0, 1.0)) -> Figure:
    """Return the table: each cell its value, below it its interval, the darker the larger.

    Args: limits: the values at the two ends of the scale.
    """
    if not limits[0] < limits[1]:
        raise PlotError(f"limits {limits} of the scale are not in order: give the lower one first")
    n_rows, n_columns = len(grid.rows), len(grid.columns)
    names = max(map(len, grid.rows)) * CHARACTER_IN + 0.1
    wrapped = [_wrapped(name, (width.value - names) / n_columns) for name in grid.columns]
    head = 0.3 + 0.1 * max(name.count("\n") + 1 for name in wrapped)
    foot = 0.2 if note else 0.06
    height = head + n_rows * CELL_IN + foot
    with rc_context(SETTINGS):
        figure = Figure(figsize=(width.value, height))
        left, body = names / width.value, n_rows * CELL_IN / height
        axes = figure.add_axes((left, foot / height, 1 - left - 0.03 / width.value, body))
        axes.set(xlim=(0, n_columns), ylim=(n_rows, 0))
        axes.set_axis_off()
        for row in range(n_rows):
            for column in range(n_columns):
                _draw_cell(axes, grid, row, column, limits)
        _name_rows_and_columns(axes, grid.rows, wrapped)
        figure.text(
            0.04 / width.value, 1 - 0.06 / height, grid.title, va="top", fontsize=SETTINGS["axes.titlesize"]
        )
        figure.text(0.5, 0.05 / height, note, ha="center", va="bottom", fontsize=6, color=MUTED)
    return figure


def short(value: float) -> str:
    """Return a share as it is set in a narrow cell: .67 and 1.0; other numbers with two digits."""
    if not 0 <= value <= 1:
        return f"{value:.2g}".replace("-", "\N{MINUS SIGN}")
    text = f"{value:.2f}"
    return "1.0" if text == "1.00" else text.removeprefix("0")


def _draw_cell(axes: Axes, grid: Grid, row: int, column: int, limits: tuple[float, float]) -> None:
    value = float(grid.values[row, column])
    if not math.isfinite(value):
        axes.text(column + 0.5, row + 0.5, "–", ha="center", va="center", color=MUTED)
        return
    depth = float(np.clip((value - limits[0]) / (limits[1] - limits[0]), 0, 1))
    axes.add_patch(Rectangle((column, row), 1, 1, facecolor=SCALE(depth), edgecolor="white", linewidth=0.8))
    interval = f"{short(float(grid.lo[row, column]))}–{short(float(grid.hi[row, column]))}"
    axes.text(column + 0.5, row + 0.36, short(value), ha="center", va="center", color="black", fontsize=7)
    axes.text(column + 0.5, row + 0.77, interval, ha="center", va="center", color="black", fontsize=4.6)


def _name_rows_and_columns(axes: Axes, rows: Sequence[str], columns: Sequence[str]) -> None:
    for row, name in enumerate(rows):
        axes.text(-0.08, row + 0.5, name, ha="right", va="center")
    for column, name in enumerate(columns):
        axes.text(column + 0.5, -0.22, name, ha="center", va="baseline", fontsize=6.2, linespacing=1.05)


def _wrapped(name: str, width_in: float) -> str:
    """Return the name with line breaks where its words and their parts would not fit beside each other."""
    room = max(1, int(width_in / (CHARACTER_IN * 0.88)))
    lines: list[str] = []
    for piece in re.findall(r"[^\s-]+-?|-", name):
        joint = "" if lines and lines[-1].endswith("-") else " "
        if lines and len(lines[-1] + joint + piece) <= room:
            lines[-1] += joint + piece
        else:
            lines.append(piece)
    return "\n".join(lines)
