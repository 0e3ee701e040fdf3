"""What an experiment leaves in its folder: tables, figures, a recording."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from services.cli.shared.failure import CommandError
from services.exports.experiment_tables import claim_table, curve_table, episode_table, seed_table
from services.exports.table import Column, ExportError, Kind
from services.exports.write import write_tables
from services.monitor.config import MonitorError
from services.monitor.experiment_recording import Course, record_courses, record_curves
from services.plots.figures import (
    require_matplotlib,
    total_grid,
    write_dots,
    write_figure2,
    write_heat_table,
)
from services.plots.model import Grid, PlotError, Width
from sfid_core.experiments.claims import Claim
from sfid_core.experiments.guidance import CONVERGED, INPUTS, STEPS
from sfid_core.experiments.intervals import Floats
from sfid_core.experiments.learners import CHECKPOINTS, total_name
from sfid_core.experiments.summary import Arm, ArmSummary, Measure

if TYPE_CHECKING:
    from services.cli.experiment.learners import LevelFindings


def check_figures() -> None:
    """Raise with the mend where figures cannot be drawn, before a long run rather than after it."""
    try:
        require_matplotlib()
    except PlotError as error:
        raise CommandError(str(error)) from None


def write_founding_files(
    folder: Path,
    arms: Sequence[Arm],
    summaries: Sequence[ArmSummary],
    claims: Sequence[Claim],
    seeds: Sequence[int],
    optimal_steps: Floats,
) -> list[Path]:
    """Write the paper's figure, its tables with a codebook, and a recording; return the files."""
    tables = (
        episode_table(arms, seeds),
        seed_table(arms, seeds),
        curve_table(summaries),
        claim_table(claims),
    )
    about = f"sfid experiment figure2, {len(seeds)} seeds from {seeds[0]}, simulated teachers"
    optimum: dict[Measure, Floats | float] = {Measure.STEPS: np.asarray(optimal_steps)}
    try:
        return [
            *write_tables(folder, about, tables),
            *write_figure2(summaries, folder / "figure2", optimum),
            record_curves(folder / "figure2.rrd", summaries),
        ]
    except (ExportError, PlotError, MonitorError) as error:
        raise CommandError(str(error)) from None


def write_learner_files(folder: Path, found: "Sequence[LevelFindings]", seeds: Sequence[int]) -> list[Path]:
    """Write a table with coloured cells for each level and checkpoint, and the tables with a codebook.

    With several levels each has a folder of its own.
    """
    try:
        return [
            path
            for one in found
            for path in _learner_files(folder if len(found) == 1 else folder / _slug(one.level), one, seeds)
        ]
    except (ExportError, PlotError, MonitorError) as error:
        raise CommandError(str(error)) from None


def _learner_files(folder: Path, found: "LevelFindings", seeds: Sequence[int]) -> Iterator[Path]:
    about = f"sfid experiment learners, level {found.level}, {len(seeds)} seeds from {seeds[0]}"
    yield from write_tables(
        folder, about, (seed_table(found.arms, seeds, _checked_columns()), claim_table(found.claims))
    )
    note = f"Means over {len(seeds):,} seeds with 95 % intervals; simulated teachers."
    for episodes in CHECKPOINTS:
        title = f"Share solved after {episodes} episodes: {found.level}"
        grid = total_grid(found.summaries, total_name("success", episodes), title)
        yield from write_heat_table(grid, folder / f"learners-{episodes}", note, Width.PAGE)
    yield record_courses(folder / "learners.rrd", _checked_courses(found.summaries), "episode")


def _checked_courses(summaries: Sequence[ArmSummary]) -> list[Course]:
    """Return a plot a teacher, a line a method: what the policy alone solves after so many episodes."""
    courses = []
    for summary in summaries:
        told = [summary.totals[total_name("success", episodes)] for episodes in CHECKPOINTS]
        mean, lo, hi = np.array([(middle, *ci) for middle, ci in told], dtype=np.float64).T
        title = f"Share solved, {summary.teacher}"
        courses.append(Course(title, summary.method, np.array(CHECKPOINTS, dtype=np.int64), mean, lo, hi))
    return courses


def _checked_columns() -> dict[str, Column]:
    kinds = {
        "success": (Kind.NUMBER, "Share of starts that the greedy policy solves after {} episodes.", ""),
        "inputs": (Kind.WHOLE, "Answers applied in the first {} episodes.", "answers"),
        "steps": (Kind.WHOLE, "Actions executed in the first {} episodes.", "steps"),
    }
    return {
        name: Column(name, kind, text.format(episodes), unit)
        for episodes in CHECKPOINTS
        for what, (kind, text, unit) in kinds.items()
        for name in (total_name(what, episodes),)
    }


class Dots(NamedTuple):
    """A figure of an experiment: what it shows, and on which scale."""

    name: str
    """Of the file, without an ending."""
    grid: Grid
    limits: tuple[float, float] | None = None
    """Of the scale; None for what the intervals need."""


def write_total_files(
    folder: Path,
    experiment: str,
    arms: Sequence[Arm],
    claims: Sequence[Claim],
    seeds: Sequence[int],
    figures: Sequence[Dots],
) -> list[Path]:
    """Write a row for every arm and seed, and the claims, with a codebook, and figures; return the files."""
    about = f"sfid experiment {experiment}, {len(seeds)} seeds from {seeds[0]}, simulated teachers"
    explained = _checked_columns() | {
        STEPS: Column(STEPS, Kind.WHOLE, "Actions until the episodes stayed near the fewest steps.", "steps"),
        INPUTS: Column(INPUTS, Kind.WHOLE, "Answers applied until then.", "answers"),
        CONVERGED: Column(CONVERGED, Kind.TRUTH, "Whether they came to; if not, the whole run is counted."),
    }
    note = f"Means over {len(seeds):,} seeds with 95 % intervals; simulated teachers."
    try:
        return [
            *write_tables(folder, about, (seed_table(arms, seeds, explained), claim_table(claims))),
            *(
                path
                for one in figures
                for path in write_dots([one.grid], folder / one.name, note, limits=one.limits)
            ),
        ]
    except (ExportError, PlotError) as error:
        raise CommandError(str(error)) from None


def write_curve_files(
    folder: Path, arms: Sequence[Arm], summaries: Sequence[ArmSummary], seeds: Sequence[int]
) -> list[Path]:
    """Write every episode and the curves with a codebook, the four measures as a figure, and a recording."""
    about = f"sfid experiment session, {len(seeds)} seeds from {seeds[0]}, simulated teachers"
    try:
        return [
            *write_tables(folder, about, (episode_table(arms, seeds), curve_table(summaries))),
            *write_figure2(summaries, folder / "session"),
            record_curves(folder / "session.rrd", summaries),
        ]
    except (ExportError, PlotError, MonitorError) as error:
        raise CommandError(str(error)) from None


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-")
