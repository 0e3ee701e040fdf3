"""Expectation maximisation for confusion matrices, over flat arrays of labels.

A label is a row (task, worker, label). Row w * K + y of a table holds, for each of the K classes, what
worker w saying y means. Labels are ordered once by task and once by row of the table: the E-step is then
one gather and one sum over runs of labels, and so is the M-step, each over all classes at once.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]
Bools = npt.NDArray[np.bool_]
TINY = 1e-10
"""A probability of 0 would forbid a class for good."""
SLOTS_MAX = 256
"""Labels a task up to which slots are worth their making: each costs a call to NumPy or two an iteration."""


class Votes(NamedTuple):
    """Labels as indices: three arrays of the same length n, and how many there are of each."""

    tasks: Ints
    workers: Ints
    labels: Ints
    task_count: int
    worker_count: int
    class_count: int


class Estimate(NamedTuple):
    """Where EM came to rest."""

    posterior: Floats
    """(tasks, K): probability of each class."""
    counts: Floats
    """(workers, K, K): expected labels at [worker, label, class], without the prior."""
    iterations: int


@dataclass(frozen=True, slots=True)
class Prior:
    """Dirichlet prior on each worker's matrix: it keeps sparse matrices from collapsing.

    A class is worth `labels` labels, spread as a worker of one accuracy would give them: the worker's own,
    which itself has the prior Beta(right, wrong).
    """

    labels: float = 1.0
    right: float = 4.0
    wrong: float = 2.0

    def accuracies(self, counts: Floats) -> Floats:
        """Return each worker's accuracy over all classes, (workers,), from counts (workers, K, K)."""
        right = np.trace(counts, axis1=1, axis2=2) + self.right
        accuracy: Floats = right / (counts.sum(axis=(1, 2)) + (self.right + self.wrong))
        return accuracy

    def pseudo_counts(self, counts: Floats) -> Floats:
        """Return what the prior adds to counts (workers, K, K)."""
        K = counts.shape[1]
        accuracy = self.accuracies(counts)
        added = np.empty_like(counts)
        added[:] = ((1 - accuracy) * (self.labels / (K - 1)))[:, None, None]
        diagonal = np.arange(K)
        added[:, diagonal, diagonal] = (accuracy * self.labels)[:, None]
        added += TINY
        return added


class Runs(NamedTuple):
    """Labels ordered by a key, so that the sum for each key is the sum of a run."""

    order: Ints
    keys: Ints
    """The keys that occur, ascending."""
    starts: Ints
    """Where the run of each begins."""

    def sums(self, rows: Floats, count: int) -> Floats:
        """Return (count, K): for each key the sum of its rows, of rows (n, K) in this order."""
        found = np.add.reduceat(rows, self.starts, axis=0)
        if len(self.keys) == count:
            return found
        sums = np.zeros((count, rows.shape[1]))
        sums[self.keys] = found
        return sums


def runs(key: Ints, count: int) -> Runs:
    """Return the labels' order by keys in [0, count); equal keys keep their order."""
    narrow = key.astype(np.uint16) if count <= 2**16 else key  # 16 bits are sorted by radix
    order = np.argsort(narrow, kind="stable")
    sizes = np.bincount(key, minlength=count)
    keys = np.flatnonzero(sizes)
    return Runs(order, keys, (np.cumsum(sizes) - sizes)[keys])


class Slots:
    """Labels by task in slots: the first label of every task, the second of those that have one, and so on.

    Where tasks have few labels, adding whole slots is up to four times faster than summing many short runs.
    """

    def __init__(self, runs: Runs, values: Ints, count: int, classes: int) -> None:
        sizes = np.diff(runs.starts, append=len(values))
        by_size = np.argsort(-sizes, kind="stable")
        starts, sizes = runs.starts[by_size], sizes[by_size]
        self._slots = [
            values[starts[: int(np.searchsorted(-sizes, -slot))] + slot] for slot in range(int(sizes[0]))
        ]
        self._places = np.full(count, len(sizes))  # a task without a label: the row of zeros at the end
        self._places[runs.keys[by_size]] = np.arange(len(sizes))
        self._sums = np.zeros((len(sizes) + 1, classes))
        self._gathered = np.empty((len(sizes), classes))

    def sums(self, table: Floats) -> Floats:
        """Return (count, K): for each task the sum of the table's rows that its labels name."""
        first, *others = self._slots
        np.take(table, first, axis=0, out=self._sums[:-1], mode="clip")
        for rows in others:
            size = len(rows)
            self._sums[:size] += np.take(table, rows, axis=0, out=self._gathered[:size], mode="clip")
        return np.take(self._sums, self._places, axis=0, mode="clip")


class Layout:
    """A set of labels in the two orders that the two steps read.

    Args: votes: at least one label; weights: (n,) weight of each label in the M-step, 1 when not given.
    """

    def __init__(self, votes: Votes, weights: Floats | None = None) -> None:
        self.tasks, self.workers, self.classes = votes.task_count, votes.worker_count, votes.class_count
        self.labels = len(votes.labels)
        rows = votes.workers * self.classes + votes.labels
        self._by_task = runs(votes.tasks, self.tasks)
        self._rows_by_task = rows[self._by_task.order]
        most = int(np.diff(self._by_task.starts, append=len(rows)).max())
        self._slots = (
            Slots(self._by_task, self._rows_by_task, self.tasks, self.classes) if most <= SLOTS_MAX else None
        )
        self._by_row = runs(rows, self.workers * self.classes)
        self._tasks_by_row = votes.tasks[self._by_row.order]
        self._weights = None if weights is None else weights[self._by_row.order, None]
        self._gathered = np.empty((len(rows), self.classes))

    def confusion_counts(self, posterior: Floats) -> Floats:
        """Return (workers, K, K): expected labels at [worker, label, class], from a posterior (tasks, K)."""
        K = self.classes
        rows = np.take(posterior, self._tasks_by_row, axis=0, out=self._gathered, mode="clip")
        if self._weights is not None:
            rows *= self._weights
        return self._by_row.sums(rows, self.workers * K).reshape(self.workers, K, K)

    def scores(self, log_likelihood: Floats) -> Floats:
        """Return (tasks, K): for each class the sum over a task's labels of ln P(label | class)."""
        table = log_likelihood.reshape(-1, self.classes)
        if self._slots is not None:
            return self._slots.sums(table)
        rows = np.take(table, self._rows_by_task, axis=0, out=self._gathered, mode="clip")
        return self._by_task.sums(rows, self.tasks)


def vote_shares(votes: Votes, weights: Floats | None = None) -> Floats:
    """Return (tasks, K): each class's share of a task's labels by weight, uniform where nothing weighs."""
    tasks, K = votes.task_count, votes.class_count
    sums = np.bincount(votes.tasks * K + votes.labels, weights, minlength=tasks * K).reshape(tasks, K)
    total = sums.sum(axis=1, keepdims=True)
    shares: Floats = np.divide(sums, total, out=np.full((tasks, K), 1.0 / K), where=total > 0)
    return shares


def log_likelihood(counts: Floats, prior: Prior) -> Floats:
    """Return ln P(label | class) at [worker, label, class]."""
    smooth = prior.pseudo_counts(counts)
    smooth += counts
    smooth /= smooth.sum(axis=1, keepdims=True)
    return np.log(smooth, out=smooth)


def class_shares(posterior: Floats) -> Floats:
    """Return ln of each class's mean probability, (K,)."""
    mean: Floats = np.ascontiguousarray(posterior.T).mean(axis=1)
    return np.log(np.maximum(mean, TINY))


def normalised(scores: Floats) -> tuple[Floats, float]:
    """Return the posterior of log-scores (tasks, K), and the sum over tasks of ln sum exp(score)."""
    by_class = np.ascontiguousarray(scores.T)  # long rows are an order of magnitude faster than rows of K
    highest = by_class.max(axis=0)
    by_class -= highest
    np.exp(by_class, out=by_class)
    total = by_class.sum(axis=0)
    by_class /= total
    return np.ascontiguousarray(by_class.T), float(highest.sum() + np.log(total).sum())


def maximise(
    layout: Layout,
    posterior: Floats,
    prior: Prior,
    *,
    fixed: Bools | None = None,
    iterations: int = 100,
    tolerance: float = 1e-5,
) -> Estimate:
    """Run EM from a first posterior until it gains no more.

    Args: posterior: (tasks, K), not changed; fixed: (tasks,) where the posterior is known and stays;
        iterations: at most so many, 1 or more; tolerance: gain of log-likelihood a label that ends it.
    Source: Dawid & Skene 1979, with a Dirichlet prior on each row of each matrix.
    """
    labels = layout.labels
    reached = -np.inf
    counts = layout.confusion_counts(posterior)
    done = 0
    while done < iterations:
        done += 1
        scores = layout.scores(log_likelihood(counts, prior))
        scores += class_shares(posterior)
        moved, total = normalised(scores)
        if fixed is not None:
            moved[fixed] = posterior[fixed]
        posterior = moved
        counts = layout.confusion_counts(posterior)
        if total - reached < tolerance * labels:
            break
        reached = total
    return Estimate(posterior, counts, done)
