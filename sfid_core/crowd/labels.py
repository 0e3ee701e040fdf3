"""A finished set of labels: who said what of which task, as names and as flat arrays of indices."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sfid_core.crowd.em import Ints, Votes
from sfid_core.learning.parameters import ParameterError

Name = str | int
Column = Sequence[Name] | npt.NDArray[np.integer]
"""A column of names; an array of integers is read much faster than a list."""


@dataclass(frozen=True, slots=True)
class LabelSet:
    """Labels in index form: tasks as they first occur, workers and classes sorted.

    Where all labels are the same there is one class name, and the votes still count two classes: the models
    choose between two or more.
    """

    task_names: Sequence[Name]
    worker_names: Sequence[Name]
    class_names: Sequence[Name]
    votes: Votes


def label_set(tasks: Column, workers: Column, labels: Column) -> LabelSet:
    """Return the set with one label a row.

    Raises: ParameterError when the columns differ in length or hold no row.
    """
    rows = len(tasks)
    if not rows == len(workers) == len(labels):
        message = f"{rows} tasks, {len(workers)} workers, {len(labels)} labels: give one of each a label"
        raise ParameterError(message)
    if rows == 0:
        raise ParameterError("the set holds no label: give at least one")
    task_names, task_ids = factorise(tasks)
    worker_names, worker_ids = factorise(workers)
    class_names, class_ids = factorise(labels)
    task_names, task_ids = by_first(task_names, task_ids)
    sizes = (len(task_names), len(worker_names), max(len(class_names), 2))
    return LabelSet(task_names, worker_names, class_names, Votes(task_ids, worker_ids, class_ids, *sizes))


def factorise(column: Column) -> tuple[list[Name], Ints]:
    """Return the different names, sorted, and each row's index into them."""
    if isinstance(column, np.ndarray):
        return _factorise_integers(column)
    known = {name: index for index, name in enumerate(sorted(set(column)))}
    return list(known), np.array([known[name] for name in column], dtype=np.intp)


def by_first(names: list[Name], ids: Ints) -> tuple[list[Name], Ints]:
    """Return the same with the names in the order of their first row."""
    first = np.empty(len(names), dtype=np.intp)
    first[ids[::-1]] = np.arange(len(ids))[::-1]  # of several writes the last one stays: the first row
    order = np.argsort(first)
    rank = np.empty(len(names), dtype=np.intp)
    rank[order] = np.arange(len(names))
    return [names[index] for index in order.tolist()], rank[ids]


def _factorise_integers(column: npt.NDArray[np.integer]) -> tuple[list[Name], Ints]:
    low, high = int(column.min()), int(column.max())
    if high - low > 8 * len(column) + 1024:  # a table of that range would cost more than sorting
        values, ids = np.unique(column, return_inverse=True)
        return list(values.tolist()), ids.astype(np.intp)
    shifted = column.astype(np.intp) - low
    seen = np.zeros(high - low + 1, dtype=bool)
    seen[shifted] = True
    place = np.cumsum(seen) - 1
    names: list[Name] = [*(np.flatnonzero(seen) + low).tolist()]
    return names, place[shifted]
