"""One confusion matrix a worker, learnt one decision after the other.

Between refreshes each decision adds its expected counts to its workers' matrices. When the labels have
grown by a quarter, EM runs over the history, so that a label costs a constant time on average. It starts
from the shares of the vote, not from what was concluded on the way: early conclusions are sure of
themselves, and a worker whose errors have a system would stay misread. Without a prior on the diagonal the
matrices of sparse data collapse; ours is centred on the worker's own accuracy, which makes a worker with
few labels a one-coin worker.
"""

from collections import deque
from collections.abc import Sequence
from math import log
from typing import NamedTuple

import numpy as np

from sfid_core.crowd.confusion import Confusion
from sfid_core.crowd.em import Floats, Ints, Layout, Prior, Votes, maximise, vote_shares
from sfid_core.crowd.evidence import Vote, influence_limit, softmax
from sfid_core.crowd.settings import CrowdSettings
from sfid_core.crowd.tally import Reliability, rated

GROWTH = 0.25
"""Share by which the labels grow before EM runs again."""
FIRST_REFRESH = 40
"""Labels before the first run: fewer say nothing about K * K numbers a worker."""
REFRESH_ITERATIONS = 20


class Closed(NamedTuple):
    """A decision of the history."""

    votes: list[tuple[int, int]]
    """Worker's index and action."""
    weight: float
    known: list[float] | None
    """The posterior where it is settled: gold, or what the solver excused."""


class DawidSkeneOnline:
    """The posterior of an action is the product of what each worker's matrix says of the label given."""

    def __init__(self, actions: int, settings: CrowdSettings) -> None:
        self._actions = actions
        self._settings = settings
        self._prior = Prior(settings.diagonal_prior, settings.prior_right, settings.prior_wrong)
        self._newcomer = max(log(settings.prior_right / settings.prior_wrong * (actions - 1)), 0.0)
        self._workers: dict[str, Confusion] = {}
        self._places: dict[str, int] = {}
        self._stranger = Confusion(actions)
        self._class_sums = [1.0] * actions
        self._history: deque[Closed] = deque()
        self._labels = 0
        self._unrefreshed = 0
        self._looked: tuple[list[Vote], tuple[list[float], list[float]]] | None = None
        """The last look: what is concluded is mostly learnt from next, and nothing has changed in between."""

    def workers(self) -> tuple[str, ...]:
        """Return everyone with a label that was learnt from, sorted by name."""
        return tuple(sorted(self._workers))

    def look(self, votes: Sequence[Vote]) -> tuple[list[float], list[float]]:
        """Return the posterior over the actions, and how far each label speaks for the action it names.

        A label's weight is its log-likelihood under the action named less the mean of the others.
        """
        if self._looked is not None and self._looked[0] == votes:
            return self._looked[1]
        workers, prior = self._workers, self._prior
        evidence = [workers.get(worker, self._stranger).evidence(action, prior) for worker, action in votes]
        if self._settings.influence_cap < 1:
            evidence = self._capped(evidence)
        scores = [log(value) for value in self._class_sums]
        for row in evidence:
            scores = [score + value for score, value in zip(scores, row, strict=True)]
        others = self._actions - 1
        weights = [
            row[action] - (sum(row) - row[action]) / others
            for (_, action), row in zip(votes, evidence, strict=True)
        ]
        self._looked = (list(votes), (softmax(scores), weights))
        return self._looked[1]

    def learn(self, votes: Sequence[Vote], acceptable: frozenset[int], gold: int | None) -> None:
        """Add the decision to the history and to the matrices.

        A label that the solver accepts is right, as if the decision had been about the action it names.
        """
        posterior = self.look(votes)[0]
        if gold is not None:
            self._close(votes, self._certain(gold), self._settings.gold_weight, fixed=True)
        else:
            for named in sorted(acceptable):
                excused = [vote for vote in votes if vote[1] == named]
                if excused:
                    self._close(excused, self._certain(named), 1.0, fixed=True)
            judged = [vote for vote in votes if vote[1] not in acceptable]
            if judged:
                self._close(judged, posterior, 1.0, fixed=len(judged) < len(votes))
        if self._unrefreshed >= max(FIRST_REFRESH, GROWTH * (self._labels - self._unrefreshed)):
            self._refresh()

    def reliability(self, worker: str) -> Reliability:
        """Return the worker's accuracy over the classes as often as they occur, with its standard error."""
        matrix = self._workers.get(worker, self._stranger)
        return rated(matrix.accuracy(self._prior), matrix.labels, 1 / self._actions, self._settings)

    def _capped(self, evidence: list[list[float]]) -> list[list[float]]:
        """Return the evidence with what spans more than the influence cap allows scaled down to it."""
        spans = [max(row) - min(row) for row in evidence]
        limit = influence_limit(spans, self._newcomer, self._settings.influence_cap)
        return [
            [value * limit / span for value in row] if span > limit else row
            for row, span in zip(evidence, spans, strict=True)
        ]

    def _certain(self, action: int) -> list[float]:
        return [float(a == action) for a in range(self._actions)]

    def _close(self, votes: Sequence[Vote], posterior: list[float], weight: float, *, fixed: bool) -> None:
        keep = self._settings.forgetting
        self._looked = None
        rows = []
        for worker, label in votes:
            matrix = self._workers.get(worker)
            if matrix is None:
                matrix = self._workers[worker] = Confusion(self._actions)
                self._places[worker] = len(self._places)
            matrix.add(label, posterior, weight, keep)
            rows.append((self._places[worker], label))
        self._class_sums = [a + b for a, b in zip(self._class_sums, posterior, strict=True)]
        self._history.append(Closed(rows, weight, posterior if fixed else None))
        self._labels += len(rows)
        self._unrefreshed += len(rows)
        while self._labels > self._settings.history_max and len(self._history) > 1:
            self._labels -= len(self._history.popleft().votes)

    def _refresh(self) -> None:
        """Run EM over the history and put its counts in the place of the running ones."""
        history = self._history
        sizes = [len(closed.votes) for closed in history]
        flat = np.array([vote for closed in history for vote in closed.votes], dtype=np.intp)
        votes = Votes(
            np.repeat(np.arange(len(history)), sizes), flat[:, 0], flat[:, 1],
            len(history), len(self._places), self._actions,
        )  # fmt: skip
        start = vote_shares(votes)
        fixed = np.array([closed.known is not None for closed in history])
        if fixed.any():
            start[fixed] = [closed.known for closed in history if closed.known is not None]
        weights = np.repeat([closed.weight for closed in history], sizes) * self._ages(flat[:, 0])
        estimate = maximise(
            Layout(votes, weights), start, self._prior, fixed=fixed, iterations=REFRESH_ITERATIONS
        )
        for matrix, counts in zip(self._workers.values(), estimate.counts.tolist(), strict=True):
            matrix.load(counts)
        self._class_sums = [1.0 + value for value in estimate.posterior.sum(axis=0).tolist()]
        self._unrefreshed = 0

    def _ages(self, workers: Ints) -> Floats:
        """Return what forgetting leaves of each label: one factor for each later label of the same worker."""
        order = np.argsort(workers, kind="stable")
        counts = np.bincount(workers)
        ends = np.repeat(np.cumsum(counts), counts)
        later = np.empty(len(workers))
        later[order] = ends - 1 - np.arange(len(workers))
        aged: Floats = self._settings.forgetting**later
        return aged
