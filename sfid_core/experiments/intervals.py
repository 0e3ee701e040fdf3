"""Intervals of means over seeds: the bootstrap, many columns at once, and two for the cases it fails in."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sfid_core.chance import stream
from sfid_core.chance_array import belows
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.student import normal_cdf, normal_quantile, t_quantile

Floats = npt.NDArray[np.float64]

BLOCK_DRAWS = 1 << 22
"""Draws held at once: 4 million counts are 32 MB, whatever the number of seeds."""


class Interval(NamedTuple):
    """From `lo` to `hi`, both included."""

    lo: float
    hi: float

    def above(self, value: float) -> bool:
        """Whether all of the interval lies above `value`."""
        return self.lo > value

    def below(self, value: float) -> bool:
        """Whether all of the interval lies below `value`."""
        return self.hi < value


class IntervalKind(Enum):
    """Which bootstrap interval."""

    PERCENTILE = "percentile"
    BCA = "bca"
    """Bias-corrected and accelerated (Efron 1987): follows the skew of what is resampled."""


@dataclass(frozen=True, slots=True)
class Resampling:
    """How bootstrap intervals are made; equal values give equal bits."""

    seed: int = 0
    """Names the draws; intervals of one experiment share them, so arms are resampled in pairs."""
    resamples: int = 2000
    """100 to 1,000,000."""
    level: float = 0.95
    """Coverage that is aimed at, in (0, 1)."""
    kind: IntervalKind = IntervalKind.PERCENTILE

    def __post_init__(self) -> None:
        if not 100 <= self.resamples <= 1_000_000:
            raise ExperimentError(f"resamples {self.resamples} is outside 100 to 1000000: 2000 is usual")
        if not 0 < self.level < 1:
            raise ExperimentError(f"level {self.level} is outside (0, 1): 0.95 is usual")

    def simultaneous(self, n_intervals: int) -> "Resampling":
        """Return the same with the level at which all of `n_intervals` hold at once (Bonferroni)."""
        return replace(self, level=1 - (1 - self.level) / max(1, n_intervals))


def bootstrap_means(values: npt.ArrayLike, resampling: Resampling) -> Floats:
    """Return the means of `values` over seeds drawn with replacement.

    Args: values: [n_seeds, ...], finite, 2 seeds or more. A draw takes whole seeds: all columns of one row
    of the result come from the same seeds, and so do those of two calls with equal resampling and n_seeds.
    Returns: float64 [resamples, ...], the same bits on every machine (see `_exact_grid`).
    Raises: ExperimentError.
    """
    rows = _checked(values)
    grid = _exact_grid(rows.reshape(len(rows), -1))
    blocks = [counts @ grid for counts in _resample_counts(len(rows), resampling)]
    means: Floats = np.concatenate(blocks) / len(rows)
    return means.reshape(resampling.resamples, *rows.shape[1:])


def exact_means(values: npt.ArrayLike) -> Floats:
    """Return the means over axis 0 with the bits that `bootstrap_means` would give for every seed once."""
    rows = _checked(values, seeds_min=1)
    sums: Floats = _exact_grid(rows.reshape(len(rows), -1)).sum(axis=0)
    return (sums / len(rows)).reshape(rows.shape[1:])


def mean_intervals(values: npt.ArrayLike, resampling: Resampling) -> Floats:
    """Return an interval of the mean over seeds for every column.

    Args: values: [n_seeds, ...], finite, 2 seeds or more.
    Returns: float64 [..., 2], lo and hi. A column without any spread gets a width of 0.
    The tails are widened for few seeds so that the width is that of Student's t where the values are
    normal (Hesterberg 2015, "What Teachers Should Know About the Bootstrap", section 3.3); at 1,000 seeds
    nothing is left of that.  Raises: ExperimentError.
    """
    rows = _checked(values)
    columns = rows.reshape(len(rows), -1)
    ordered = np.sort(bootstrap_means(columns, resampling), axis=0)
    z = math.sqrt(len(rows) / (len(rows) - 1)) * t_quantile((1 + resampling.level) / 2, len(rows) - 1)
    if resampling.kind is IntervalKind.BCA:
        ranks = _bca_ranks(columns, ordered, z)
    else:
        ranks = np.broadcast_to([[normal_cdf(-z)], [normal_cdf(z)]], (2, columns.shape[1]))
    return _at_ranks(ordered, ranks).T.reshape(*rows.shape[1:], 2)


def mean_interval(values: npt.ArrayLike, resampling: Resampling) -> Interval:
    """Return the interval of the mean of one number a seed; see `mean_intervals`."""
    lo, hi = mean_intervals(np.asarray(values, dtype=np.float64).reshape(-1), resampling)
    return Interval(float(lo), float(hi))


def student_interval(values: npt.ArrayLike, level: float = 0.95) -> Interval:
    """Return Student's interval of the mean of one number a seed: mean +- t * sd / sqrt(n), 2 seeds or more.

    Source: Student 1908. It is the interval that two one-sided tests look at.
    """
    column = _checked(values).reshape(-1)
    half = t_quantile((1 + level) / 2, len(column) - 1) * standard_error(column)
    mean = float(exact_means(column))
    return Interval(mean - half, mean + half)


def wilson_intervals(shares: npt.ArrayLike, n_trials: int, level: float = 0.95) -> Floats:
    """Return Wilson's score interval of every share of successes in `n_trials` independent trials.

    Unlike the bootstrap it keeps a width where all trials agree. For means of numbers in [0, 1] that are
    no plain successes it is wider than needed, never narrower.
    Args: shares: [...], each in [0, 1]. Returns: float64 [..., 2]. Source: Wilson 1927.
    """
    p = np.asarray(shares, dtype=np.float64)
    if n_trials < 1 or not ((p >= 0) & (p <= 1)).all():
        raise ExperimentError(f"shares outside [0, 1] or {n_trials} trials have no Wilson interval")
    z = normal_quantile((1 + level) / 2)
    scale = 1 + z * z / n_trials
    centre = (p + z * z / (2 * n_trials)) / scale
    half = z / scale * np.sqrt(p * (1 - p) / n_trials + z * z / (4 * n_trials * n_trials))
    # At the edges rounding leaves 1e-17 beside the exact 0 or 1.
    lo = np.where(p == 0, 0.0, centre - half)
    hi = np.where(p == 1, 1.0, centre + half)
    return np.stack([lo, hi], axis=-1)


def standard_error(column: Floats) -> float:
    """Return sd / sqrt(n) of one number a seed, exactly 0 where all are equal; 2 seeds or more."""
    if (column == column[0]).all():
        return 0.0
    deviations = column - float(exact_means(column))
    return math.sqrt(math.fsum(deviations * deviations) / (len(column) - 1) / len(column))


def _checked(values: npt.ArrayLike, seeds_min: int = 2) -> Floats:
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim == 0 or len(rows) < seeds_min:
        seeds = 0 if rows.ndim == 0 else len(rows)
        raise ExperimentError(f"{seeds} seeds: this needs at least {seeds_min}; run more seeds")
    faulty = ~np.isfinite(rows.reshape(len(rows), -1)).all(axis=1)
    if faulty.any():
        raise ExperimentError(f"seed number {int(faulty.argmax())} has a value that is not a finite number")
    return rows


def _exact_grid(columns: Floats) -> Floats:
    """Round each column to a power-of-two grid on which sums over n seeds are exact in float64.

    Any order of adding then gives the same bits, so results do not depend on the linear algebra library or
    its threads. The grid has 2^(52 - log2 n) steps below the column's largest value: for 1,000 seeds a
    relative 2^-42, far below what sampling leaves open.
    """
    bits = 52 - math.ceil(math.log2(len(columns) + 1))
    _, exponents = np.frexp(np.abs(columns).max(axis=0))
    # Below 2^-970 the step itself would leave the normal floats; such columns are 0 for every purpose.
    step = np.ldexp(1.0, np.maximum(exponents, -970) - bits)
    grid: Floats = np.rint(columns / step) * step
    return grid


def _resample_counts(n_seeds: int, resampling: Resampling) -> Iterator[Floats]:
    """Yield float64 [rows, n_seeds]: how often each resample drew each seed, block after block."""
    key = stream(resampling.seed, "bootstrap", n_seeds)
    rows_max = max(1, BLOCK_DRAWS // n_seeds)
    for first in range(0, resampling.resamples, rows_max):
        rows = min(rows_max, resampling.resamples - first)
        drawn = belows(key, np.arange(first * n_seeds, (first + rows) * n_seeds), n_seeds)
        cells = drawn.reshape(rows, n_seeds) + np.arange(rows)[:, np.newaxis] * n_seeds
        counts = np.bincount(cells.reshape(-1), minlength=rows * n_seeds)
        yield counts.reshape(rows, n_seeds).astype(np.float64)


def _bca_ranks(columns: Floats, ordered: Floats, z: float) -> Floats:
    """Return float64 [2, n_columns]: the quantiles that BCa takes, by bias z0 and acceleration a.

    z0 = quantile of the share of resampled means below the mean;  a = sum e^3 / (6 (sum e^2)^1.5) with
    e the deviations from the mean (the jackknife of a mean).  Source: Efron 1987.
    """
    means = exact_means(columns)
    deviations = columns - means
    spread = np.sqrt((deviations**2).sum(axis=0))
    unit = deviations / np.where(spread > 0, spread, 1)
    accelerations = (unit**3).sum(axis=0) / 6
    below = ((ordered < means).sum(axis=0) + (ordered <= means).sum(axis=0)) / (2 * len(ordered))
    ranks = np.empty((2, columns.shape[1]))
    for column, (share, a) in enumerate(zip(below.tolist(), accelerations.tolist(), strict=True)):
        z0 = normal_quantile(min(max(share, 0.5 / len(ordered)), 1 - 0.5 / len(ordered)))
        for side, edge in enumerate((z0 - z, z0 + z)):
            ranks[side, column] = normal_cdf(z0 + edge / max(1e-9, 1 - a * edge))
    return ranks


def _at_ranks(ordered: Floats, ranks: Floats) -> Floats:
    """Return float64 [2, n_columns]: each sorted column at its two ranks, linear between neighbours."""
    positions = ranks * (len(ordered) - 1)
    lower = np.floor(positions).astype(np.int64)
    upper = np.minimum(lower + 1, len(ordered) - 1)
    at_lower = np.take_along_axis(ordered, lower, axis=0)
    at_upper = np.take_along_axis(ordered, upper, axis=0)
    result: Floats = at_lower + (positions - lower) * (at_upper - at_lower)
    return result
