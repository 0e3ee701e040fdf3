"""What is known of each worker's accuracy: counts of right and wrong labels under a Beta prior."""

from enum import StrEnum
from math import log, sqrt
from typing import NamedTuple

from sfid_core.crowd.settings import CrowdSettings

ACCURACY_MAX = 0.99
"""Nobody is believed further than this, nor its opposite: one label stays within ln(99 (K - 1))."""
DEVIATIONS = 2.0
"""Standard deviations between a worker and chance before one is told from the other."""


class Standing(StrEnum):
    """What a worker is taken for."""

    UNKNOWN = "unknown"
    """Too few labels to say."""
    GOOD = "good"
    SPAM = "spam"
    """Answers as chance would: the labels weigh nothing."""
    ADVERSARY = "adversary"
    """Answers wrong more often than chance would: the labels count against the action they name."""


class Reliability(NamedTuple):
    """How often a worker is right, as far as is known."""

    mean: float
    """Estimated probability that a label is right, in (0, 1)."""
    standard_error: float
    labels: int
    """Labels that the estimate rests on."""
    standing: Standing = Standing.UNKNOWN


class Tally:
    """One worker's counts, forgotten slowly; what the prior says is not forgotten."""

    __slots__ = ("labels", "right", "wrong")

    def __init__(self) -> None:
        self.right = 0.0
        self.wrong = 0.0
        self.labels = 0


class Tallies:
    """The counts of all workers.

    Args: actions: number of actions K, at least 2.
    """

    def __init__(self, actions: int, settings: CrowdSettings) -> None:
        self._chance = 1.0 / actions
        self._others = actions - 1
        self._settings = settings
        self._of: dict[str, Tally] = {}

    def workers(self) -> tuple[str, ...]:
        """Return everyone with a label that was learnt from, sorted by name."""
        return tuple(sorted(self._of))

    def add(self, worker: str, right: float, wrong: float) -> None:
        """Count one label as so much right and so much wrong, each 0 or more."""
        tally = self._of.get(worker)
        if tally is None:
            tally = self._of[worker] = Tally()
        keep = self._settings.forgetting
        tally.right = tally.right * keep + right
        tally.wrong = tally.wrong * keep + wrong
        tally.labels += 1

    def mean(self, worker: str) -> float:
        """Return the estimated probability that the worker is right; a stranger's is the prior's."""
        settings = self._settings
        tally = self._of.get(worker)
        if tally is None:
            return settings.prior_right / (settings.prior_right + settings.prior_wrong)
        right, wrong = settings.prior_right + tally.right, settings.prior_wrong + tally.wrong
        return right / (right + wrong)

    def reliability(self, worker: str) -> Reliability:
        """Return mean and standard deviation of the worker's Beta posterior."""
        settings = self._settings
        tally = self._of.get(worker) or Tally()
        right, wrong = settings.prior_right + tally.right, settings.prior_wrong + tally.wrong
        return rated(right / (right + wrong), tally.labels, self._chance, settings)

    def log_odds(self, worker: str) -> float:
        """Return what one label of the worker adds to the log-odds of the action it names.

        ln((K - 1) s / (1 - s)) for the accuracy s is the optimal weight of a label whose errors fall evenly
        on the other actions; 0 for a spammer, below 0 for an adversary alone. Source: Nitzan & Paroush
        1982.
        """
        mean, _, _, taken_for = self.reliability(worker)
        if taken_for is Standing.SPAM or (taken_for is not Standing.ADVERSARY and mean <= self._chance):
            return 0.0
        s = min(max(mean, 1 - ACCURACY_MAX), ACCURACY_MAX)
        return log(self._others * s / (1 - s))


def rated(mean: float, labels: int, chance: float, settings: CrowdSettings) -> Reliability:
    """Return a worker's reliability from the estimated accuracy and the number of labels behind it.

    The standard error is that of a Beta distribution worth the prior and the labels not forgotten; a gold
    label moves the mean by more than an ordinary one, yet counts once here.
    """
    keep = settings.forgetting
    remembered = labels if keep == 1 else (1 - keep**labels) / (1 - keep)
    error = sqrt(mean * (1 - mean) / (settings.prior_right + settings.prior_wrong + remembered + 1))
    if labels < settings.spam_after:
        return Reliability(mean, error, labels, Standing.UNKNOWN)
    return Reliability(mean, error, labels, standing(mean, error, chance))


def standing(mean: float, error: float, chance: float) -> Standing:
    """Return what a worker of that accuracy is taken for, where answering by chance gives `chance`."""
    if mean + DEVIATIONS * error < chance:
        return Standing.ADVERSARY
    if mean - DEVIATIONS * error <= chance:
        return Standing.SPAM
    return Standing.GOOD
