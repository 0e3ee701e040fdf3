"""What an experiment's arms come to: a curve with its interval for each measure, and a number a seed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import (
    Floats,
    Interval,
    Resampling,
    exact_means,
    mean_interval,
    mean_intervals,
    wilson_intervals,
)


class Measure(Enum):
    """What is measured in every episode; the first four are the founding paper's (Figure 2)."""

    ABS_TD_ERROR = "abs_td_error"
    STEPS = "steps"
    DISCOUNTED_RETURN = "discounted_return"
    INPUTS = "inputs"
    ABS_TD_ERROR_SHAPED = "abs_td_error_shaped"
    DISCOUNTED_ENV_RETURN = "discounted_env_return"
    SOLVED = "solved"


FOUNDING_MEASURES = (
    Measure.ABS_TD_ERROR,
    Measure.STEPS,
    Measure.DISCOUNTED_RETURN,
    Measure.INPUTS,
)


SHARES = frozenset({"agreed", "converged"})
"""Totals that are 1 or 0 for each seed; their mean is a share of seeds."""


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """One condition's results; arms of one experiment have the same seeds in the same order.

    Raises: ExperimentError where a table has another form.
    """

    method: str
    teacher: str
    measures: Mapping[Measure, Floats]
    """float64 [n_seeds, n_episodes] each."""
    totals: Mapping[str, Floats] = field(default_factory=dict)
    """One number a seed, float64 [n_seeds] each: teaching effort, time, labels to agreement, success."""

    def __post_init__(self) -> None:
        shapes = {np.shape(table) for table in self.measures.values()}
        seeds = {shape[:1] for shape in shapes} | {np.shape(column) for column in self.totals.values()}
        if len(shapes) > 1 or len(seeds) != 1 or any(len(shape) != 2 for shape in shapes):
            raise ExperimentError(
                f"tables of arm {self.name} disagree: measures {sorted(shapes)}, totals and seeds "
                f"{sorted(seeds)}; give [n_seeds, n_episodes] and [n_seeds]"
            )

    @property
    def name(self) -> str:
        """Return how the arm is called in claims and legends."""
        return f"{self.method}, {self.teacher}"

    def per_seed(self, measure: Measure) -> Floats:
        """Return each seed's mean over its episodes, float64 [n_seeds]."""
        return exact_means(np.transpose(self.measures[measure]))


@dataclass(frozen=True, slots=True, eq=False)
class ArmSummary:
    """One condition over its seeds."""

    method: str
    teacher: str
    n_seeds: int
    means: Mapping[Measure, Floats]
    """float64 [n_episodes] each."""
    intervals: Mapping[Measure, Floats]
    """float64 [n_episodes, 2] each: lo and hi of the mean."""
    totals: Mapping[str, tuple[float, Interval]]
    """Mean and interval of every number a seed."""

    @property
    def name(self) -> str:
        """Return how the arm is called in claims and legends."""
        return f"{self.method}, {self.teacher}"

    def document(self) -> dict[str, Any]:
        """Return the summary for JSON: `steps` the means, `steps_ci` the intervals, and so on."""
        document: dict[str, Any] = {"method": self.method, "teacher": self.teacher, "seeds": self.n_seeds}
        for measure, means in self.means.items():
            document[measure.value] = means.tolist()
            document[f"{measure.value}_ci"] = self.intervals[measure].tolist()
        for name, (mean, ci) in self.totals.items():
            document[name] = mean
            document[f"{name}_ci"] = list(ci)
        return document


def summarise(arms: Sequence[Arm], resampling: Resampling) -> tuple[ArmSummary, ...]:
    """Return each arm's means and intervals, all made from the same resamples of seeds.

    Intervals are bootstrap intervals, but Wilson's for shares of seeds (SOLVED and `SHARES`), which are
    often all 1.
    Raises: ExperimentError.
    """
    return tuple(_summary(arm, resampling) for arm in arms)


def _summary(arm: Arm, resampling: Resampling) -> ArmSummary:
    means: dict[Measure, Floats] = {}
    intervals: dict[Measure, Floats] = {}
    for measure, table in arm.measures.items():
        means[measure] = exact_means(table)
        if measure is Measure.SOLVED:
            intervals[measure] = wilson_intervals(means[measure], len(table), resampling.level)
    resampled = [measure for measure in arm.measures if measure is not Measure.SOLVED]
    if resampled:
        stacked = np.stack([arm.measures[measure] for measure in resampled], axis=1)
        found = mean_intervals(stacked, resampling)
        intervals |= {measure: found[position] for position, measure in enumerate(resampled)}
    totals = {name: _total(name, column, resampling) for name, column in arm.totals.items()}
    seeds = next(len(table) for table in (*arm.measures.values(), *arm.totals.values()))
    ordered = {measure: intervals[measure] for measure in arm.measures}
    return ArmSummary(arm.method, arm.teacher, seeds, means, ordered, totals)


def _total(name: str, column: Floats, resampling: Resampling) -> tuple[float, Interval]:
    mean = float(exact_means(column))
    if name in SHARES:
        lo, hi = wilson_intervals(mean, len(column), resampling.level).tolist()
        return mean, Interval(lo, hi)
    return mean, mean_interval(column, resampling)
