"""Two arms over the same seeds: their difference, how large it is, and whether they are equivalent."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import (
    Floats,
    Interval,
    Resampling,
    exact_means,
    mean_interval,
    standard_error,
    student_interval,
    wilson_intervals,
)
from sfid_core.experiments.student import t_upper_tail


@dataclass(frozen=True, slots=True)
class Comparison:
    """Arm a minus arm b, seed by seed."""

    n_seeds: int
    mean_a: float
    mean_b: float
    difference: float
    """mean_a - mean_b."""
    ci: Interval
    """Bootstrap interval of the difference."""
    cohen_dz: float | None
    superiority: float
    superiority_ci: Interval


@dataclass(frozen=True, slots=True)
class Equivalence:
    """Two one-sided t tests (Schuirmann 1987) of |mean difference| < margin."""

    n_seeds: int
    difference: float
    ci: Interval
    """Student's interval at 1 - 2 alpha: both tests reject exactly where it lies within the margins."""
    margin: float
    p: float
    """The larger of the two one-sided p values."""
    holds: bool


def compare(a: npt.ArrayLike, b: npt.ArrayLike, resampling: Resampling) -> Comparison:
    """Compare two arms, one number a seed, the same seeds in the same order.

    Raises: ExperimentError where they are not of one length of 2 seeds or more.
    """
    first, second = _paired(a, b)
    share = superiority(first, second)
    lo, hi = wilson_intervals(share, len(first), resampling.level)
    return Comparison(
        n_seeds=len(first),
        mean_a=float(exact_means(first)),
        mean_b=float(exact_means(second)),
        difference=float(exact_means(first - second)),
        ci=mean_interval(first - second, resampling),
        cohen_dz=cohen_dz(first, second),
        superiority=share,
        superiority_ci=Interval(float(lo), float(hi)),
    )


def cohen_dz(a: npt.ArrayLike, b: npt.ArrayLike) -> float | None:
    """Return the mean of the paired differences over their standard deviation (Cohen 1988, section 2.3.5).

    0 where every difference is 0; None where all are one other number, for then it has no bound.
    """
    first, second = _paired(a, b)
    differences = first - second
    deviation = standard_error(differences) * math.sqrt(len(differences))
    mean = float(exact_means(differences))
    if deviation == 0:
        return 0.0 if mean == 0 else None
    return mean / deviation


def superiority(a: npt.ArrayLike, b: npt.ArrayLike) -> float:
    """Return the share of seeds in which a is larger than b, a tie counting half (Grissom & Kim 2005)."""
    first, second = _paired(a, b)
    return float(np.count_nonzero(first > second) + np.count_nonzero(first >= second)) / (2 * len(first))


def equivalence(a: npt.ArrayLike, b: npt.ArrayLike, margin: float, alpha: float = 0.05) -> Equivalence:
    """Test whether two arms differ by less than `margin`, 0 or more, in either direction.

    Where all differences are equal there is nothing to test: it holds if they are within the margin.
    Raises: ExperimentError.
    """
    if not (margin >= 0 and math.isfinite(margin)):
        raise ExperimentError(
            f"margin {margin} is no finite number of 0 or more: give 0.1 of a reference mean"
        )
    if not 0 < alpha < 0.5:
        raise ExperimentError(f"alpha {alpha} is outside (0, 0.5): 0.05 is usual")
    first, second = _paired(a, b)
    differences = first - second
    mean, error = float(exact_means(differences)), standard_error(differences)
    if error == 0:
        p = 0.0 if abs(mean) < margin else 1.0
    else:
        p = t_upper_tail((margin - abs(mean)) / error, len(differences) - 1)
    ci = student_interval(differences, 1 - 2 * alpha)
    return Equivalence(len(differences), mean, ci, margin, p, p < alpha)


def _paired(a: npt.ArrayLike, b: npt.ArrayLike) -> tuple[Floats, Floats]:
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if first.ndim != 1 or first.shape != second.shape:
        raise ExperimentError(
            f"arms of shape {first.shape} and {second.shape} are no pairs: run both with the same seeds"
        )
    return first, second
