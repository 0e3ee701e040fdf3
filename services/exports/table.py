"""A tidy table before it is a file: one row an observation, one column a variable, each explained."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Self

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[Any] | Sequence[Any]


class ExportError(Exception):
    """A table cannot be made or written; the text is one line: what is wrong, where, and the mend."""


class Kind(Enum):
    """What the cells of a column are; each may be missing, a number also as not-a-number."""

    TEXT = "text"
    WHOLE = "whole number"
    NUMBER = "number"
    TRUTH = "true or false"


@dataclass(frozen=True, slots=True)
class Column:
    """One variable."""

    name: str
    kind: Kind
    description: str
    """One sentence for the codebook."""
    unit: str = ""
    """Empty where there is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Columns with their cells, all of one length; None and not-a-number are missing cells.

    Raises: ExportError where columns and cells do not fit.
    """

    name: str
    """Of the files, without an ending."""
    title: str
    """One sentence: what a row is."""
    columns: tuple[Column, ...]
    cells: Mapping[str, Values]
    """By the name of the column."""

    def __post_init__(self) -> None:
        names = [column.name for column in self.columns]
        if len(set(names)) < len(names) or set(names) != set(self.cells):
            raise ExportError(
                f"table {self.name} explains {sorted(names)} and holds {sorted(self.cells)}: "
                "give every column once, with its cells"
            )
        if len({len(cells) for cells in self.cells.values()}) > 1:
            lengths = {name: len(cells) for name, cells in self.cells.items()}
            raise ExportError(f"table {self.name} has columns of different lengths: {lengths}")

    @classmethod
    def of_rows(
        cls, name: str, title: str, columns: tuple[Column, ...], rows: Sequence[Sequence[Any]]
    ) -> Self:
        """Return the table of these rows, their cells in the order of the columns. Raises: ExportError."""
        cells: dict[str, Values] = {
            column.name: [row[place] for row in rows] for place, column in enumerate(columns)
        }
        return cls(name, title, columns, cells)

    @property
    def n_rows(self) -> int:
        """Return the number of rows."""
        return len(next(iter(self.cells.values()), ()))

    def listed(self, column: Column) -> list[Any]:
        """Return the cells of a column as Python values, None where one is missing.

        Raises: ExportError where a cell is not of the column's kind.
        """
        cells = self.cells[column.name]
        if isinstance(cells, np.ndarray):
            quick = _listed_at_once(column.kind, cells)
            if quick is not None:
                return quick
            cells = cells.tolist()
        try:
            return [_cell(column.kind, value) for value in cells]
        except (TypeError, ValueError, OverflowError) as error:
            raise ExportError(
                f"table {self.name}, column {column.name}: {error}; give each cell as a {column.kind.value}"
            ) from error


def _listed_at_once(kind: Kind, cells: npt.NDArray[Any]) -> list[Any] | None:
    """Return the cells of an array that is of this kind and complete, None where each has to be looked at.

    An experiment has a million cells; one at a time they take seconds.
    """
    if cells.dtype.kind not in "fiub" or not np.isfinite(cells).all():
        return None
    types = {Kind.NUMBER: np.float64, Kind.WHOLE: np.int64, Kind.TRUTH: np.bool_}
    if kind not in types:
        return None
    converted: npt.NDArray[Any] = cells.astype(types[kind])
    if (converted != cells).any():
        return None
    values: list[Any] = converted.tolist()
    return values


def _cell(kind: Kind, value: object) -> object:
    """Return the value as `kind` says, None where it is missing."""
    if value is None or value != value:  # noqa: PLR0124 - not-a-number is the one value that differs from itself
        return None
    match kind, value:
        case Kind.TEXT, str():
            return value
        case Kind.NUMBER, int() | float() | np.number():
            return float(value)
        case Kind.TRUTH, _ if value in {0, 1}:
            return bool(value)
        case Kind.WHOLE, int() | float() | np.number() if int(value) == value:
            return int(value)
    raise TypeError(f"{value!r} does not fit")
