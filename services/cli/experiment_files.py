"""What an experiment leaves in its folder: tables, figures, a recording."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from services.cli.failure import CommandError
from services.exports.experiment_tables import claim_table, curve_table, episode_table, seed_table
from services.exports.table import Column, ExportError, Kind
from services.exports.write import write_tables
from services.monitor.config import MonitorError
from services.monitor.experiment_recording import record_curves
from services.plots.figures import require_matplotlib, total_grid, write_figure2, write_heat_table
from services.plots.model import PlotError, Width
from sfid_core.experiments.claims import Claim
from sfid_core.experiments.guidance import CONVERGED, INPUTS, STEPS
from sfid_core.experiments.intervals import Floats
from sfid_core.experiments.learners import CHECKPOINTS, total_name
from sfid_core.experiments.summary import Arm, ArmSummary, Measure

if TYPE_CHECKING:
    from services.cli.experiment_learners import LevelFindings


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
    except (ExportError, PlotError) as error:
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


def write_total_files(
    folder: Path, experiment: str, arms: Sequence[Arm], claims: Sequence[Claim], seeds: Sequence[int]
) -> list[Path]:
    """Write a row for every arm and seed, and the claims, with a codebook; return the files."""
    about = f"sfid experiment {experiment}, {len(seeds)} seeds from {seeds[0]}, simulated teachers"
    explained = _checked_columns() | {
        STEPS: Column(STEPS, Kind.WHOLE, "Actions until the episodes stayed near the fewest steps.", "steps"),
        INPUTS: Column(INPUTS, Kind.WHOLE, "Answers applied until then.", "answers"),
        CONVERGED: Column(CONVERGED, Kind.TRUTH, "Whether they came to; if not, the whole run is counted."),
    }
    try:
        return list(write_tables(folder, about, (seed_table(arms, seeds, explained), claim_table(claims))))
    except ExportError as error:
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
