"""What a study shows, told honestly: an interval over people for all of it, no claim below ten of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sfid_core.chance import stream
from sfid_core.experiments.intervals import (
    Floats,
    Interval,
    Resampling,
    bootstrap_means,
    exact_means,
    mean_interval,
)
from sfid_core.experiments.student import normal_cdf, t_quantile
from sfid_core.study.errors import StudyError

PEOPLE_MIN = 10
"""In each condition; below it no claim holds, whatever its interval: a bootstrap of fewer is not to be
trusted."""


@dataclass(frozen=True, slots=True)
class PeopleClaim:
    """That two conditions differ in something: whether it is shown, and what shows it."""

    what: str
    first: str
    other: str
    people: tuple[int, int]
    means: tuple[float, float] | None
    """None: too few people for a mean with an interval."""
    difference: float | None
    """First minus other."""
    ci: Interval | None
    level: float
    """Coverage of `ci`; wide enough that all intervals of the study hold at once."""
    paired: bool

    @property
    def enough(self) -> bool:
        """Whether there are people enough for a claim."""
        return min(self.people) >= PEOPLE_MIN

    @property
    def holds(self) -> bool:
        """Whether it is shown that the conditions differ."""
        return self.enough and self.ci is not None and (self.ci.above(0) or self.ci.below(0))

    @property
    def verdict(self) -> str:
        """Return what may be said."""
        if not self.enough:
            return "too few people to say"
        return "shown" if self.holds else "not shown"

    @property
    def sentence(self) -> str:
        """Return the claim in words."""
        return f"{self.first} and {self.other} differ in {self.what}"

    def line(self) -> str:
        """Return the claim for a terminal; one that is not supported says so first."""
        counted = (
            f"{self.people[0]} people" if self.paired else f"{self.people[0]} and {self.people[1]} people"
        )
        if self.ci is None or self.difference is None or self.means is None:
            return f"{self.verdict}: {self.sentence} ({counted})"
        numbers = f"{self.means[0]:.3g} and {self.means[1]:.3g}, {self.difference:+.3g}"
        interval = f"[{self.ci.lo:+.3g}, {self.ci.hi:+.3g}]"
        return f"{self.verdict}: {self.sentence}: {numbers} {interval} ({counted}, {self.level:.1%} interval)"

    def document(self) -> dict[str, Any]:
        """Return the claim for JSON."""
        return {
            "claim": self.sentence,
            "holds": self.holds,
            "verdict": self.verdict,
            "means": None if self.means is None else list(self.means),
            "difference": self.difference,
            "ci": None if self.ci is None else list(self.ci),
            "level": self.level,
            "people": list(self.people),
            "paired": self.paired,
        }


Columns = Mapping[str, Mapping[str, float]]
"""By condition: one number a person, by pseudonym."""


def difference_claim(
    what: str, names: tuple[str, str], columns: Columns, resampling: Resampling, *, paired: bool
) -> PeopleClaim:
    """Return whether two conditions differ in the mean over people.

    Args: names: the two conditions; paired: everybody met both, so that each person is compared with
    themselves, and who misses one is left out.  Raises: ExperimentError.
    """
    a, b = (columns.get(name, {}) for name in names)
    if paired:
        shared = sorted(a.keys() & b.keys())
        a, b = {who: a[who] for who in shared}, {who: b[who] for who in shared}
    first, other = (np.array([column[who] for who in sorted(column)]) for column in (a, b))
    counts = (len(first), len(other))
    if min(counts) < 2:
        return PeopleClaim(what, *names, counts, None, None, None, resampling.level, paired)
    means = (float(exact_means(first)), float(exact_means(other)))
    ci = (
        mean_interval(first - other, resampling) if paired else independent_interval(first, other, resampling)
    )
    return PeopleClaim(what, *names, counts, means, means[0] - means[1], ci, resampling.level, paired)


def independent_interval(a: Floats, b: Floats, resampling: Resampling) -> Interval:
    """Return a bootstrap interval of mean(a) - mean(b) for two groups of different people, 2 or more in each.

    Each group is resampled by itself. The tails are widened as in `intervals.mean_intervals`, by the smaller
    group (Hesterberg 2015, section 3.3).  Raises: ExperimentError, StudyError.
    """
    smaller = min(len(a), len(b))
    if smaller < 2:
        raise StudyError(f"groups of {len(a)} and {len(b)} people have no interval: 2 in each are the least")
    apart = replace(resampling, seed=stream(resampling.seed, "other group"))
    drawn = np.sort(bootstrap_means(a, resampling) - bootstrap_means(b, apart))
    z = float(np.sqrt(smaller / (smaller - 1))) * t_quantile((1 + resampling.level) / 2, smaller - 1)
    lo, hi = np.quantile(drawn, [normal_cdf(-z), normal_cdf(z)])
    return Interval(float(lo), float(hi))


def claims_of(
    names: Sequence[str], measured: Mapping[str, Columns], resampling: Resampling, *, paired: bool
) -> tuple[PeopleClaim, ...]:
    """Return whether the first condition differs from each other one in each thing measured.

    Args: names: conditions; measured: by what it is, in words.
    The intervals hold all at once (Bonferroni): the more is asked of the same people, the less each answer
    may be left to luck.
    """
    pairs = [(names[0], other) for other in names[1:]]
    how = resampling.simultaneous(len(pairs) * len(measured))
    return tuple(
        difference_claim(what, pair, columns, how, paired=paired)
        for pair in pairs
        for what, columns in measured.items()
    )
