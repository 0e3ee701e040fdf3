"""Expectation maximisation for confusion matrices, over flat arrays of labels.

A label is a row (task, worker, label). Row w * K + y of a table holds what worker w saying y means for each of the
K classes, so that one gather and one sum over tasks make the E-step, and one sum over these rows the M-step.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]
TINY = 1e-10
"""A probability of 0 would forbid a class for good."""


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
    """(workers, K, K): expected labels y of each worker on tasks of class c, at [w, y, c], without the prior."""
    iterations: int


def vote_shares(votes: Votes, weights: Floats | None = None) -> Floats:
    """Return (tasks, K): each class's share of a task's weight, uniform where nothing weighs."""
    tasks, K = votes.task_count, votes.class_count
    sums = np.bincount(votes.tasks * K + votes.labels, weights, minlength=tasks * K).reshape(tasks, K)
    total = sums.sum(axis=1, keepdims=True)
    return np.divide(sums, total, out=np.full((tasks, K), 1.0 / K), where=total > 0)


def confusion_counts(votes: Votes, posterior: Floats, weights: Floats | None = None) -> Floats:
    """Return (workers, K, K): expected labels at [worker, label, class]."""
    workers, K = votes.worker_count, votes.class_count
    rows = votes.workers * K + votes.labels
    counts = np.empty((workers * K, K))
    for c in range(K):
        seen = posterior[:, c][votes.tasks]
        if weights is not None:
            seen *= weights
        counts[:, c] = np.bincount(rows, seen, minlength=workers * K)
    return counts.reshape(workers, K, K)


def log_likelihood(counts: Floats, prior: Floats) -> Floats:
    """Return ln P(label y | class c) at [w, y, c], from counts and the prior's counts at [y, c]."""
    with_prior = counts + (prior + TINY)
    return np.log(with_prior / with_prior.sum(axis=1, keepdims=True))


def class_posterior(votes: Votes, log_table: Floats, log_classes: Floats) -> Floats:
    """Return (tasks, K): the classes' posterior from each label's log-likelihood and the classes' log-prior."""
    tasks, K = votes.task_count, votes.class_count
    table = log_table.reshape(-1, K)
    rows = votes.workers * K + votes.labels
    scores = np.empty((tasks, K))
    for c in range(K):
        scores[:, c] = np.bincount(votes.tasks, table[:, c][rows], minlength=tasks)
    scores += log_classes
    scores -= scores.max(axis=1, keepdims=True)
    np.exp(scores, out=scores)
    scores /= scores.sum(axis=1, keepdims=True)
    return scores


def class_shares(posterior: Floats) -> Floats:
    """Return ln of each class's mean probability, (K,)."""
    mean: Floats = posterior.mean(axis=0)
    return np.log(np.maximum(mean, TINY))


def diagonal_prior(K: int, labels: float, accuracy: float) -> Floats:
    """Return (K, K): a prior worth so many labels a class, of which the share `accuracy` on the diagonal."""
    return np.full((K, K), labels * (1 - accuracy) / (K - 1)) + np.eye(K) * labels * (
        accuracy - (1 - accuracy) / (K - 1)
    )


def maximise(
    votes: Votes,
    posterior: Floats,
    prior: Floats,
    *,
    weights: Floats | None = None,
    fixed: npt.NDArray[np.bool_] | None = None,
    iterations: int = 100,
    tolerance: float = 1e-5,
) -> Estimate:
    """Run EM from a first posterior until it moves no more.

    Args: votes: at least one label; posterior: (tasks, K), not changed; prior: (K, K) counts at [y, c];
        weights: (n,) weight of each label in the counts; fixed: (tasks,) whose posterior is known and stays;
        iterations: at most so many; tolerance: mean change of a task's posterior that ends it.
    Source: Dawid & Skene 1979, with a Dirichlet prior on each row of each matrix.
    """
    counts = confusion_counts(votes, posterior, weights)
    done = 0
    for done in range(1, iterations + 1):
        moved = class_posterior(votes, log_likelihood(counts, prior), class_shares(posterior))
        if fixed is not None:
            moved[fixed] = posterior[fixed]
        change = float(np.abs(moved - posterior).sum()) / votes.task_count
        posterior = moved
        counts = confusion_counts(votes, posterior, weights)
        if change < tolerance:
            break
    return Estimate(posterior, counts, done)
