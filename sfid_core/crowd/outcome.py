"""What a batch method makes of a set of labels, and how ties are settled."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sfid_core.chance import below, stream
from sfid_core.crowd.em import Floats, Votes
from sfid_core.crowd.evidence import TIE
from sfid_core.crowd.labels import Name
from sfid_core.learning.parameters import ParameterError


class Outcome(NamedTuple):
    """Posteriors of the tasks, reliabilities of the workers."""

    posterior: Floats
    """(tasks, K); majority and weighted: shares of the vote."""
    reliability: Floats
    """(workers,): estimated probability that a label is right."""
    standard_error: Floats
    """(workers,)"""


def beta_error(mean: Floats, labels: npt.NDArray[np.floating]) -> Floats:
    """Return the standard deviation of a Beta distribution with that mean, worth so many labels."""
    error: Floats = np.sqrt(mean * (1 - mean) / (labels + 1))
    return error


def agreement(votes: Votes, credit: Floats) -> tuple[Floats, Floats]:
    """Return each worker's mean credit and its standard error, both (workers,).

    One label right and one wrong are added, so that three labels are not taken for certainty.
    Args: credit: (n,) how far each label is right, in [0, 1].
    """
    right = np.bincount(votes.workers, credit, minlength=votes.worker_count) + 1.0
    total = np.bincount(votes.workers, minlength=votes.worker_count) + 2.0
    mean = right / total
    return mean, beta_error(mean, total)


def winners(posterior: Floats) -> Floats:
    """Return (tasks, K): 1 at the most probable class; the m classes of a tie have 1/m each."""
    best = posterior >= posterior.max(axis=1, keepdims=True) - TIE
    shared: Floats = best / best.sum(axis=1, keepdims=True)
    return shared


def decided(
    posterior: Floats, names: Sequence[Name], seed: int | None, abstain_below: float = 0.0
) -> list[int | None]:
    """Return the class of each task, None for an abstention.

    A tie is settled by a draw that the seed and the task's name fix, never by the order of rows or classes;
    with seed None it is an abstention. Below the threshold nothing is said either.
    """
    by_class = np.ascontiguousarray(posterior.T)  # long rows are much faster than rows of K
    best = by_class.max(axis=0)
    tied = by_class >= best - TIE
    classes: list[int | None] = posterior.argmax(axis=1).tolist()
    for task in np.flatnonzero(tied.sum(axis=0) > 1).tolist():
        first = np.flatnonzero(tied[:, task]).tolist()
        classes[task] = None if seed is None else first[_drawn(seed, names[task], len(first))]
    for task in np.flatnonzero(best < abstain_below - TIE).tolist():
        classes[task] = None
    return classes


def accuracy(answers: Mapping[Name, Name | None], truth: Mapping[Name, Name]) -> float:
    """Return the share of the answered tasks with a known truth that got it right; an abstention did not.

    Raises: ParameterError when no task has a known truth.
    """
    known = [task for task in answers if task in truth]
    if not known:
        raise ParameterError("no task of the labels has a known truth: both files must name the same tasks")
    return sum(answers[task] == truth[task] for task in known) / len(known)


def _drawn(seed: int, task: Name, n: int) -> int:
    return below(stream(seed, "crowd-tie", task), 0, n)
