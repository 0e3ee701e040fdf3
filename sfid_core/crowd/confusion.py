"""One worker's running confusion matrix, under a prior that is centred on the worker's own accuracy."""

from collections.abc import Sequence
from math import log

from sfid_core.crowd.em import Prior

SCALE_MAX = 1e100
"""Far from the largest float: the counts are brought back to scale 1 before they get there."""


class Confusion:
    """Expected labels of one worker, `counts[label][action]`, with what is needed to read them quickly.

    Forgetting is done by letting later labels weigh more: every number held is `scale` times what it stands
    for.
    """

    __slots__ = ("counts", "labels", "right", "scale", "totals")

    def __init__(self, actions: int) -> None:
        self.labels = 0
        self.load([[0.0] * actions for _ in range(actions)])

    def load(self, counts: list[list[float]]) -> None:
        """Take these counts for the ones held; the number of labels stays."""
        self.counts = counts
        self.totals: list[float] = [sum(column) for column in zip(*counts, strict=True)]
        self.right: float = sum(row[label] for label, row in enumerate(counts))
        self.scale = 1.0

    def add(self, label: int, posterior: Sequence[float], weight: float, keep: float) -> None:
        """Count a label on a decision of that posterior; earlier ones keep the share `keep` of theirs."""
        self.labels += 1
        self.scale /= keep
        grown = weight * self.scale
        row, totals = self.counts[label], self.totals
        for action, probability in enumerate(posterior):
            added = grown * probability
            row[action] += added
            totals[action] += added
        self.right += grown * posterior[label]
        if self.scale > SCALE_MAX:
            self.load([[count / self.scale for count in row] for row in self.counts])

    def accuracy(self, prior: Prior) -> float:
        """Return the expected share of right labels."""
        before = (prior.right + prior.wrong) * self.scale
        return (prior.right * self.scale + self.right) / (before + sum(self.totals))

    def evidence(self, label: int, prior: Prior) -> list[float]:
        """Return ln P(label | action) for each action."""
        totals, row = self.totals, self.counts[label]
        accuracy, weigh = self.accuracy(prior), prior.labels * self.scale
        off = (1 - accuracy) * weigh / (len(totals) - 1)
        found = [log((count + off) / (total + weigh)) for count, total in zip(row, totals, strict=True)]
        found[label] = log((row[label] + accuracy * weigh) / (totals[label] + weigh))
        return found
