"""The founding paper's stop rule, measured: does the agent act as the teacher prefers, and since when?"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import (
    Floats,
    Interval,
    Resampling,
    exact_means,
    mean_interval,
    wilson_intervals,
)

CENSORED = -1
"""The episode of a seed that was not in agreement before its run ended."""


@dataclass(frozen=True, slots=True, eq=False)
class Onset:
    """Since when each seed's agent acts as the teacher prefers."""

    episodes: npt.NDArray[np.int64]
    """int64 [n_seeds]: number of the first episode in agreement, from 0; CENSORED where there is none."""
    n_episodes: int
    reached: float
    """Share of seeds in agreement before the run ended."""
    reached_ci: Interval
    median: int | None
    """Episodes that half of the seeds needed; None where fewer than half got there."""
    restricted_mean: float
    """Mean of min(episodes needed, n_episodes): censored seeds count with the whole run, a lower bound."""
    restricted_mean_ci: Interval

    @property
    def censored(self) -> int:
        """Return the number of seeds that never got there."""
        return int((self.episodes == CENSORED).sum())

    def needed(self) -> Floats:
        """Return float64 [n_seeds]: episodes before agreement, the whole run for censored seeds."""
        return np.where(self.episodes == CENSORED, self.n_episodes, self.episodes).astype(np.float64)


def onset(agreement: npt.ArrayLike, threshold: float, n_lasting: int, resampling: Resampling) -> Onset:
    """Return from which episode on agreement is at least `threshold` for `n_lasting` episodes in a row.

    Args: agreement: [n_seeds, n_episodes] in [0, 1]; n_lasting: 1 to n_episodes. A stretch that the end
    of the run cuts off does not count.  Raises: ExperimentError.
    """
    table = np.asarray(agreement, dtype=np.float64)
    if table.ndim != 2 or not 1 <= n_lasting <= table.shape[1]:
        raise ExperimentError(
            f"agreement of shape {table.shape} over {n_lasting} episodes: "
            "give [n_seeds, n_episodes] and a stretch of 1 to n_episodes"
        )
    n_seeds, n_episodes = table.shape
    agrees: npt.NDArray[np.bool_] = table >= threshold
    stretches: npt.NDArray[np.bool_] = np.all(sliding_window_view(agrees, n_lasting, axis=1), axis=2)
    reached = stretches.any(axis=1)
    episodes = np.where(reached, stretches.argmax(axis=1), CENSORED)
    needed = np.where(reached, episodes, n_episodes).astype(np.float64)
    in_order = np.sort(needed)[(n_seeds - 1) // 2]
    share = float(reached.mean())
    lo, hi = wilson_intervals(share, n_seeds, resampling.level).tolist()
    return Onset(
        episodes=episodes,
        n_episodes=n_episodes,
        reached=share,
        reached_ci=Interval(lo, hi),
        median=None if in_order == n_episodes else int(in_order),
        restricted_mean=float(exact_means(needed)),
        restricted_mean_ci=mean_interval(needed, resampling),
    )


def inputs_until(inputs: npt.ArrayLike, episodes: npt.NDArray[np.int64]) -> Floats:
    """Return how many answers each seed's teacher gave before agreement.

    Args: inputs: [n_seeds, n_episodes]; episodes: as `Onset.episodes`. Returns: float64 [n_seeds]; a
    censored seed counts all of its answers, a lower bound.
    """
    table = np.asarray(inputs, dtype=np.float64)
    last = np.where(episodes == CENSORED, table.shape[1], episodes)
    before = np.arange(table.shape[1]) < last[:, np.newaxis]
    sums: Floats = (table * before).sum(axis=1)
    return sums


def agreement_totals(
    agreement: npt.ArrayLike, inputs: npt.ArrayLike, threshold: float, n_lasting: int
) -> dict[str, Floats]:
    """Return what an arm's totals say of agreement, each float64 [n_seeds].

    Args: as `onset` and `inputs_until`. Returns: `agreement` after the last episode, `agreed` 1 or 0,
    `episodes_to_agreement` and `labels_to_agreement`, in which censored seeds count with the whole run.
    """
    table = np.asarray(agreement, dtype=np.float64)
    found = onset(table, threshold, n_lasting, Resampling(resamples=100))
    return {
        "agreement": table[:, -1],
        "agreed": (found.episodes != CENSORED).astype(np.float64),
        "episodes_to_agreement": found.needed(),
        "labels_to_agreement": inputs_until(inputs, found.episodes),
    }
