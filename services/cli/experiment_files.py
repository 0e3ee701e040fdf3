"""What an experiment leaves in its folder: tables, figures, a recording."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from services.cli.failure import CommandError
from services.exports.experiment_tables import claim_table, curve_table, episode_table, seed_table
from services.exports.table import ExportError
from services.exports.write import write_tables
from services.monitor.config import MonitorError
from services.monitor.experiment_recording import record_curves
from services.plots.figures import require_matplotlib, write_figure2
from services.plots.model import PlotError
from sfid_core.experiments.claims import Claim
from sfid_core.experiments.intervals import Floats
from sfid_core.experiments.summary import Arm, ArmSummary, Measure


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
