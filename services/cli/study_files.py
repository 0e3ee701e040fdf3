"""What `sfid study report` writes: tables with a codebook, figures, and the report as one page."""

from pathlib import Path

import numpy as np

from services.cli.shared.failure import CommandError
from services.exports.study_tables import study_tables
from services.exports.table import ExportError
from services.exports.write import write_tables
from services.plots.figures import FIGURE2_PANELS, curve_lines, require_matplotlib, write_curves, write_dots
from services.plots.model import Grid, Panel, PlotError, Width
from services.study.report import report_html
from services.study.tally import Tally
from sfid_core.experiments.summary import Measure
from sfid_core.study.effort import SCALES
from sfid_core.study.findings import Findings


def check_figures() -> None:
    """Raise with the mend where figures cannot be drawn."""
    try:
        require_matplotlib()
    except PlotError as error:
        raise CommandError(str(error)) from None


def write_report(folder: Path, found: Findings, counts: Tally) -> list[Path]:
    """Write everything and return the files, report.html last."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        about = f"Study {found.study.name}: {found.study.title}. Real people unless it was a rehearsal."
        files = [*write_tables(folder, about, study_tables(found))]
        shown: list[tuple[str, Path]] = []
        for caption, pair in (
            ("Learning, episode by episode", _figure2(folder, found)),
            ("Effort, scale by scale", _effort(folder, found)),
        ):
            files += pair
            shown += [(caption, path) for path in pair if path.suffix == ".png"]
        page = folder / "report.html"
        page.write_text(report_html(found, counts, shown), encoding="utf-8")
    except (ExportError, PlotError) as error:
        raise CommandError(str(error)) from None
    except OSError as error:
        message = f"{folder}: {error.strerror or error}: name an --out folder that can be written"
        raise CommandError(message) from None
    return [*files, page]


def _figure2(folder: Path, found: Findings) -> tuple[Path, ...]:
    """Write the paper's 2 x 2 figure for people; nothing as long as no condition has two of them."""
    if not found.summaries:
        return ()
    optimum = _optimum(found)
    panels = [
        Panel(
            title,
            curve_lines(found.summaries, measure),
            optimum=optimum if measure is Measure.STEPS else None,
            from_zero=from_zero,
        )
        for measure, title, from_zero in FIGURE2_PANELS
    ]
    people = " and ".join(str(arm.n_seeds) for arm in found.summaries)
    note = f"Means over {people} people; bands: 95% intervals over people."
    return write_curves(panels, folder / "figure2", note, Width.PAGE)


def _optimum(found: Findings) -> float | None:
    """Return the mean of the fewest steps over all whole lessons, None where the solver does not know."""
    lessons = [lesson for one in found.participants for lesson in one.lessons.values() if lesson.is_whole]
    known = [episode.optimal_steps for lesson in lessons for episode in lesson.episodes]
    steps = [step for step in known if step is not None]
    return float(np.mean(steps)) if steps and len(steps) == len(known) else None


def _effort(folder: Path, found: Findings) -> tuple[Path, ...]:
    rated = [one for one in found.effort if one.people > 1]
    if not rated:
        return ()
    values = np.stack([one.means for one in rated], axis=1)
    intervals = np.stack([one.intervals for one in rated], axis=1)
    rows = (*(scale.dimension for scale in SCALES), "Raw score")
    columns = tuple(one.condition for one in rated)
    grid = Grid("", rows, columns, values, intervals[:, :, 0], intervals[:, :, 1])
    people = " and ".join(str(one.people) for one in rated)
    note = f"Means over {people} people with 95% intervals; performance: 0 is perfect."
    return write_dots([grid], folder / "effort", note, Width.PAGE, (0.0, 100.0))
