"""One confusion matrix a worker, by expectation maximisation over the whole set."""

import numpy as np

from sfid_core.crowd.em import Layout, Prior, maximise, vote_shares
from sfid_core.crowd.labels import LabelSet
from sfid_core.crowd.outcome import Outcome, beta_error

PRIOR = Prior(labels=0.1, right=1.0, wrong=0.5)
"""A tenth of a label a class smooths, and leaves the method what it is elsewhere; where workers gave few
labels a whole one does better."""


def dawid_skene(
    labels: LabelSet, prior: Prior = PRIOR, iterations: int = 100, tolerance: float = 1e-5
) -> Outcome:
    """Return the posteriors under the full model, which also sees errors with a system.

    A worker's reliability is the expected share of right labels. Arguments and source: `em.maximise`.
    """
    votes = labels.votes
    estimate = maximise(Layout(votes), vote_shares(votes), prior, iterations=iterations, tolerance=tolerance)
    given = np.bincount(votes.workers, minlength=votes.worker_count) + prior.right + prior.wrong
    reliability = prior.accuracies(estimate.counts)
    return Outcome(estimate.posterior, reliability, beta_error(reliability, given))
