"""`sfid experiment guidance`: the benefit of guidance as the room grows."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from services.cli.experiment.shared import Out, Plain, Seeds, Workers, print_findings, run_all, seed_range
from services.cli.shared.options import Json, Seed, Starts, print_json
from services.cli.shared.tables import print_whole
from sfid_core.experiments.guidance import CONVERGED, INPUTS, STEPS, Benefit
from sfid_core.experiments.summary import ArmSummary

if TYPE_CHECKING:
    from services.cli.experiment.files import Dots


def add_to(app: typer.Typer) -> None:
    """Add the experiment."""
    app.command()(guidance)


def guidance(
    seeds: Seeds = 100,
    seed: Seed = 0,
    starts: Starts = "4",
    out: Out = None,
    workers: Workers = 0,
    no_compile: Plain = False,
    as_json: Json = False,
) -> None:
    """Steps to converge with rewards, with guidance and with undo, in rooms of 4 x 4 to 7 x 7 cells."""
    from services.cli.experiment.files import write_total_files
    from sfid_core.experiments import guidance as experiment
    from sfid_core.experiments.intervals import Resampling
    from sfid_core.experiments.summary import summarise

    numbers = seed_range(seed, seeds)
    conditions = experiment.conditions(starts)
    run = run_all(conditions, numbers, workers, out, plain=no_compile)
    arms = [experiment.arm(*pair) for pair in zip(conditions, run.results, strict=True)]
    resampling = Resampling(seed=seed)
    summaries, claims = summarise(arms, resampling), experiment.claims(arms, resampling)
    benefits = experiment.benefits(arms, resampling)
    files = []
    if out is not None:
        files = write_total_files(out, "guidance", arms, claims, numbers, figures(summaries, benefits))
    if as_json:
        print_json({
            "seeds": seeds, "seconds": run.seconds, "sha256": run.sha256,
            "arms": [_arm(summary) for summary in summaries],
            "benefits": [{"room": one.room, "method": one.method, "ratio": one.ratio, "ci": list(one.ci)}
                         for one in benefits],
            "claims": [claim.document() for claim in claims], "files": [str(path) for path in files],
        })  # fmt: skip
        return
    console = Console()
    print_whole(guidance_table(summaries, benefits), console)
    print_findings(console, claims, files)


def _arm(summary: ArmSummary) -> dict[str, Any]:
    document: dict[str, Any] = {"room": summary.teacher, "method": summary.method}
    for name in (STEPS, INPUTS, CONVERGED):
        mean, interval = summary.totals[name]
        document[name] = [mean, *interval]
    return document


def figures(summaries: Sequence[ArmSummary], benefits: Sequence[Benefit]) -> "list[Dots]":
    """Return the steps that each way of teaching needs in each room, and how many times fewer they are."""
    from services.cli.experiment.files import Dots
    from services.plots.figures import total_grid
    from services.plots.model import Grid

    steps = total_grid(summaries, STEPS, "Steps to converge")
    ways = dict.fromkeys(one.method for one in benefits)
    rooms = dict.fromkeys(one.room for one in benefits)
    known = {(one.room, one.method): (one.ratio, *one.ci) for one in benefits}
    cells = np.array([[known[room, way] for way in ways] for room in rooms], dtype=np.float64)
    fewer = Grid("Times fewer steps than rewards alone", tuple(rooms), tuple(ways), *np.moveaxis(cells, 2, 0))
    turned = Grid(steps.title, steps.columns, steps.rows, steps.values.T, steps.lo.T, steps.hi.T)
    return [Dots("guidance-steps", turned), Dots("guidance", fewer)]


def guidance_table(summaries: Sequence[ArmSummary], benefits: Sequence[Benefit]) -> Table:
    """Return a row for every room and way of teaching."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for name in ("room", "teaching"):
        table.add_column(name)
    for name in ("steps to converge", "converged", "answers", "times fewer steps"):
        table.add_column(name, justify="right")
    known = {(one.room, one.method): one for one in benefits}
    for summary in summaries:
        found = known.get((summary.teacher, summary.method))
        ratio = f"{found.ratio:.2f} [{found.ci.lo:.2f}, {found.ci.hi:.2f}]" if found else ""
        table.add_row(
            summary.teacher,
            summary.method,
            f"{summary.totals[STEPS][0]:.0f}",
            f"{summary.totals[CONVERGED][0]:.0%}",
            f"{summary.totals[INPUTS][0]:.0f}",
            ratio,
        )
    return table
