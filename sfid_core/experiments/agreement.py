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


def state_agreement(values: npt.ArrayLike, preferred: npt.NDArray[np.bool_]) -> Floats:
    """Return how probably a greedy agent takes an action that the teacher prefers, in every state.

    Args: values: Q, [..., n_states, n_actions]; preferred: bool [n_states, n_actions].
    Returns: float64 [..., n_states] in [0, 1]: the preferred share of the best actions, for ties are broken
    at random: an untaught state counts as luck, not as agreement.
    """
    q = np.asarray(values, dtype=np.float64)
    best = q == q.max(axis=-1, keepdims=True)
    shares: Floats = (best & preferred).sum(axis=-1) / best.sum(axis=-1)
    return shares


def greedy_visits(
    values: npt.NDArray[np.float64],
    successor: npt.NDArray[np.int32],
    terminal: npt.NDArray[np.bool_],
    starts: npt.ArrayLike,
    steps_max: int,
) -> Floats:
    """Return how often a greedy agent is expected to decide in each state, from starts of equal weight.

    Args: values: Q, [n_states, n_actions]; successor: as in TabularMDP; terminal: [n_states]; starts: states;
    steps_max: decisions of an episode. Returns: float64 [n_states], summing to the expected steps. Exact:
    the probability is moved along all best actions, nothing is drawn.
    """
    q = np.asarray(values, dtype=np.float64)
    best = q == q.max(axis=-1, keepdims=True)
    policy = best / best.sum(axis=-1, keepdims=True)
    places = np.asarray(starts, dtype=np.int64)
    if not len(places):
        raise ExperimentError("a greedy run needs at least one start state")
    present: Floats = np.bincount(places, minlength=len(q)) / len(places)
    visits = np.zeros(len(q))
    for _ in range(steps_max):
        present = np.where(terminal, 0.0, present)
        if not present.any():
            break
        visits += present
        moved = present[:, np.newaxis] * policy
        arrived = np.bincount(successor.reshape(-1), weights=moved.reshape(-1), minlength=len(q))
        present = arrived.astype(np.float64, copy=False)
    return visits


def weighted_agreement(shares: npt.ArrayLike, weights: npt.ArrayLike) -> Floats:
    """Return the mean of `state_agreement` over states, weighted by visits or by 1 for a chosen set.

    Args: shares, weights: [..., n_states], weights of 0 or more; they broadcast.
    Raises: ExperimentError where a weight row is all 0: there is nothing to agree on.
    """
    given = np.asarray(weights, dtype=np.float64)
    total = given.sum(axis=-1)
    if not (total > 0).all():
        raise ExperimentError("agreement over no states: give visits of at least one step a seed")
    agreement: Floats = (np.asarray(shares, dtype=np.float64) * given).sum(axis=-1) / total
    return agreement


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
