"""Sentences with a number behind them: a claim holds only where its interval supports it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from sfid_core.experiments.comparison import compare, equivalence
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import Interval, Resampling, exact_means, mean_interval

SEEDS_MIN = 10
"""Below this no claim holds, whatever its interval: a bootstrap of fewer seeds is not to be trusted."""


class Direction(Enum):
    """Which way arm a is said to differ from arm b."""

    LESS = "less"
    MORE = "more"


@dataclass(frozen=True, slots=True)
class Claim:
    """A sentence, whether it is shown, and what shows it."""

    claim: str
    holds: bool
    difference: float
    ci: Interval
    level: float = 0.95
    """Coverage of `ci`."""
    n_seeds: int = 0
    margin: float | None = None
    """How far from 0 still counts as equivalent; None where the claim is none of equivalence."""
    cohen_dz: float | None = None
    superiority: float | None = None
    """Share of seeds in which arm a is larger, a tie counting half."""
    unit: str = ""
    """Of the difference, its interval and the margin; empty for a number without one."""

    def measured_in(self, unit: str) -> "Claim":
        """Return the claim with its unit."""
        return replace(self, unit=unit)

    def line(self) -> str:
        """Return the claim for a terminal; a claim that is not supported says so first."""
        verdict = "holds" if self.holds else "not shown"
        if self.n_seeds < SEEDS_MIN:
            verdict += f" (fewer than {SEEDS_MIN} seeds)"
        within = "" if self.margin is None else f", margin {self.margin:.3g}"
        unit = f" {self.unit}" if self.unit else ""
        numbers = f"{self.difference:+.3g} [{self.ci.lo:+.3g}, {self.ci.hi:+.3g}]{unit}{within}"
        return f"{verdict}: {self.claim}: {numbers} ({self.n_seeds} seeds, {self.level:.0%} interval)"

    def document(self) -> dict[str, Any]:
        """Return the claim for JSON; keys that say nothing about this claim are left out."""
        document: dict[str, Any] = {
            "claim": self.claim,
            "holds": self.holds,
            "difference": self.difference,
            "ci": list(self.ci),
            "level": self.level,
            "seeds": self.n_seeds,
        }
        optional = {
            "unit": self.unit or None,
            "margin": self.margin,
            "cohen_dz": self.cohen_dz,
            "superiority": self.superiority,
        }
        return document | {name: value for name, value in optional.items() if value is not None}


def differs(
    claim: str, a: npt.ArrayLike, b: npt.ArrayLike, direction: Direction, resampling: Resampling
) -> Claim:
    """Claim that a is less (or more) than b in the mean over seeds.

    Args: a, b: one number a seed, the same seeds in the same order.
    Holds where the whole bootstrap interval of a - b lies on that side of 0.  Raises: ExperimentError.
    """
    found = compare(a, b, resampling)
    shown = found.ci.below(0) if direction is Direction.LESS else found.ci.above(0)
    return Claim(
        claim,
        shown and found.n_seeds >= SEEDS_MIN,
        found.difference,
        found.ci,
        resampling.level,
        found.n_seeds,
        cohen_dz=found.cohen_dz,
        superiority=found.superiority,
    )


def is_equivalent(
    claim: str,
    a: npt.ArrayLike,
    b: npt.ArrayLike,
    margin_share: float = 0.1,
    alpha: float = 0.05,
) -> Claim:
    """Claim that a differs from b by less than `margin_share` of b's mean, in either direction.

    Args: a, b: one number a seed, the same seeds in the same order; b is the reference.
    Holds where both one-sided t tests reject at `alpha`; the interval is at 1 - 2 alpha, as they are.
    Raises: ExperimentError.
    """
    margin = margin_share * abs(float(exact_means(b)))
    found = equivalence(a, b, margin, alpha)
    return Claim(
        claim,
        found.holds and found.n_seeds >= SEEDS_MIN,
        found.difference,
        found.ci,
        1 - 2 * alpha,
        found.n_seeds,
        margin=found.margin,
    )


def is_extreme(
    claim: str,
    a: npt.ArrayLike,
    others: Mapping[str, npt.ArrayLike],
    direction: Direction,
    resampling: Resampling,
) -> Claim:
    """Claim that a is less (or more) than each of the others.

    The difference and interval are those to the rival that comes nearest to refuting it. It holds where all
    intervals support it, so each keeps its own level (an intersection-union test, Berger 1982).
    Raises: ExperimentError.
    """
    if not others:
        raise ExperimentError(f"claim '{claim}' has nobody to be compared with: give another arm")
    rivals = [
        differs(f"{claim} (nearest: {name})", a, other, direction, resampling)
        for name, other in others.items()
    ]
    if direction is Direction.LESS:
        return max(rivals, key=lambda rival: rival.ci.hi)
    return min(rivals, key=lambda rival: rival.ci.lo)


def reaches(claim: str, values: npt.ArrayLike, threshold: float, resampling: Resampling) -> Claim:
    """Claim that the mean over seeds is above `threshold`; the difference is the mean minus it."""
    column = np.asarray(values, dtype=np.float64).reshape(-1) - threshold
    ci = mean_interval(column, resampling)
    holds = ci.above(0) and len(column) >= SEEDS_MIN
    return Claim(claim, holds, float(exact_means(column)), ci, resampling.level, len(column))
