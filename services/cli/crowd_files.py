"""Labels and truth from CSV files, each fault with its line and its mend."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from services.cli.shared.failure import CommandError

BYTES_MAX = 2**30
"""A gibibyte: some forty million labels, more than fits into memory in index form and as text at once."""


class Rows(NamedTuple):
    """The columns of a file of labels, as text."""

    tasks: list[str]
    workers: list[str]
    labels: list[str]
    superseded: int
    """Rows left out because the same worker labelled the same task again further down."""


def read_labels(path: Path) -> Rows:
    """Return the columns task, worker and label; of several labels by a worker on a task the last counts.

    Raises: CommandError, one line with the line's number and the mend.
    """
    last: dict[tuple[str, str], str] = {}
    rows = 0
    for _, (task, worker, label) in _cells(path, ("task", "worker", "label")):
        rows += 1
        last[task, worker] = label
    tasks, workers = [task for task, _ in last], [worker for _, worker in last]
    return Rows(tasks, workers, list(last.values()), rows - len(last))


def read_truth(path: Path) -> dict[str, str]:
    """Return the true label by task. Raises: CommandError, also where two rows disagree."""
    truth: dict[str, str] = {}
    for line, (task, label) in _cells(path, ("task", "label")):
        if truth.setdefault(task, label) != label:
            message = (
                f"{path}, line {line}: task {task!r} was {truth[task]!r} and is now {label!r}: "
                "give each task one true label"
            )
            raise CommandError(message)
    return truth


def _cells(path: Path, columns: tuple[str, ...]) -> Iterator[tuple[int, list[str]]]:
    """Yield (line number, cells of these columns) for each row of the file; at least one."""
    reader = csv.reader(io.StringIO(_text(path), newline=""), strict=True)
    places: list[int] = []
    width = rows = 0
    try:
        for row in reader:
            if not row:
                continue
            if not places:
                places, width = _places(path, reader.line_num, row, columns), len(row)
                continue
            rows += 1
            yield (
                reader.line_num,
                _picked(path, reader.line_num, row, width, dict(zip(columns, places, strict=True))),
            )
    except csv.Error as error:
        raise CommandError(f"{path}, line {reader.line_num}: {error}: close every quote") from None
    if not rows:
        wanted = ",".join(columns)
        raise CommandError(f"{path}: no rows: give a header {wanted} and one row a label below it")


def _picked(path: Path, line: int, row: list[str], width: int, places: dict[str, int]) -> list[str]:
    if len(row) != width:
        message = (
            f"{path}, line {line}: {len(row)} cells under a header of {width}: "
            "give each column one cell, and quote a cell that holds a comma"
        )
        raise CommandError(message)
    for name, place in places.items():
        if not row[place].strip():
            raise CommandError(f"{path}, line {line}: the {name} is empty: fill it in or delete the row")
    return [row[place] for place in places.values()]


def _places(path: Path, line: int, header: list[str], columns: tuple[str, ...]) -> list[int]:
    names = [name.strip().lower() for name in header]
    for column in columns:
        if names.count(column) != 1:
            fault = "twice" if column in names else "missing"
            message = (
                f"{path}, line {line}: the column {column!r} is {fault}: "
                f"begin the file with a header that names {','.join(columns)}"
            )
            raise CommandError(message)
    return [names.index(column) for column in columns]


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > BYTES_MAX:
            message = f"{path}: larger than {BYTES_MAX:,} bytes: split it into files of whole tasks"
            raise CommandError(message)
        content = path.read_bytes()
    except OSError as error:
        message = f"{path}: {error.strerror or error}: name a CSV file that can be read"
        raise CommandError(message) from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise CommandError(f"{path}, line {line}: not UTF-8: save the file as UTF-8 text") from None
