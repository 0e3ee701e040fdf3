"""What a figure shows, before anything is drawn."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


class PlotError(Exception):
    """A figure cannot be drawn or written; the text is one line: what is wrong, where, and the mend."""


class Width(Enum):
    """Width of a figure in inches, as journals set it; fonts are the same in both."""

    COLUMN = 3.5
    PAGE = 7.0


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A curve with its interval: x, mean, lo and hi have one length."""

    label: str
    x: Floats
    mean: Floats
    lo: Floats
    hi: Floats
    hue: int = 0
    """Which colour and marker, from 0; lines of one hue belong together (a method)."""
    dash: int = 0
    """Which line style, from 0 (a teacher)."""

    def __post_init__(self) -> None:
        lengths = {len(part) for part in (self.x, self.mean, self.lo, self.hi)}
        if len(lengths) != 1 or not len(self.x):
            raise PlotError(
                f"line {self.label} has parts of lengths {sorted(lengths)}: give one length, 1 or more"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """One pair of axes with its lines."""

    title: str
    lines: tuple[Line, ...]
    x_label: str = "Episode"
    optimum: Floats | float | None = None
    """What the best possible agent would reach, for every x of the first line or for all."""
    from_zero: bool = True
    """Whether the vertical axis starts at 0."""


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Values with intervals by row and column; a cell that is not a number stays empty.

    Args: values, lo, hi: float64 [len(rows), len(columns)].
    """

    title: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: Floats
    lo: Floats
    hi: Floats

    def __post_init__(self) -> None:
        wanted = (len(self.rows), len(self.columns))
        shapes = [np.shape(part) for part in (self.values, self.lo, self.hi)]
        if shapes != [wanted] * 3 or 0 in wanted:
            raise PlotError(f"grid '{self.title}' has cells of shapes {shapes} for {wanted} rows and columns")


def as_floats(values: Sequence[float] | Floats) -> Floats:
    """Return the values as a float64 array."""
    return np.asarray(values, dtype=np.float64)
