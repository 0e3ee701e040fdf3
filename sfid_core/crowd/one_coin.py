"""One accuracy a worker, by expectation maximisation over the whole set."""

import numpy as np

from sfid_core.crowd.em import Floats, Ints, Prior, Votes, class_shares, normalised, vote_shares
from sfid_core.crowd.labels import LabelSet
from sfid_core.crowd.outcome import Outcome, beta_error

PRIOR = Prior(labels=0.0, right=1.0, wrong=0.5)
"""Weak, yet above chance: of a labelling and its mirror image it takes the honest one."""


def one_coin(
    labels: LabelSet, prior: Prior = PRIOR, iterations: int = 100, tolerance: float = 1e-5
) -> Outcome:
    """Return the posteriors under a model whose workers err evenly on all other classes.

    Args: prior: its Beta part; iterations: at most so many; tolerance: gain of log-likelihood a label that
        ends it.
    Source: Dawid & Skene 1979 with one parameter a worker.
    """
    votes = labels.votes
    K = votes.class_count
    given = np.bincount(votes.workers, minlength=votes.worker_count).astype(np.float64)
    total = given + prior.right + prior.wrong
    cells = votes.tasks * K + votes.labels
    posterior = vote_shares(votes)
    accuracy = _accuracies(votes, cells, posterior, prior, total)
    reached = -np.inf
    for _ in range(iterations):
        odds = np.log(accuracy * (K - 1)) - np.log1p(-accuracy)
        added = np.bincount(cells, odds[votes.workers], minlength=votes.task_count * K)
        posterior, gained = normalised(added.reshape(-1, K) + class_shares(posterior))
        gained += float((given * np.log((1 - accuracy) / (K - 1))).sum())
        accuracy = _accuracies(votes, cells, posterior, prior, total)
        if gained - reached < tolerance * len(cells):
            break
        reached = gained
    return Outcome(posterior, accuracy, beta_error(accuracy, total))


def _accuracies(votes: Votes, cells: Ints, posterior: Floats, prior: Prior, total: Floats) -> Floats:
    right = np.bincount(votes.workers, posterior.reshape(-1)[cells], minlength=votes.worker_count)
    found: Floats = (right + prior.right) / total
    return found
