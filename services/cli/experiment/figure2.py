"""`sfid experiment figure2`: the founding paper's comparison, over many seeds."""

from collections.abc import Sequence
from typing import Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from services.cli.experiment.shared import (
    Out,
    Plain,
    Seeds,
    Workers,
    print_findings,
    run_all,
    seed_range,
    world_spec,
)
from services.cli.shared.options import Json, Level, Seed, Starts, print_json
from services.cli.shared.tables import print_whole
from sfid_core.experiments.summary import ArmSummary, Measure


def add_to(app: typer.Typer) -> None:
    """Add the experiment."""
    app.command()(figure2)


def figure2(
    seeds: Seeds = 100,
    seed: Seed = 0,
    level: Level = "room",
    starts: Starts = "4",
    out: Out = None,
    workers: Workers = 0,
    no_compile: Plain = False,
    as_json: Json = False,
) -> None:
    """The founding paper's experiment: sfid and reward, an expert and a naive teacher, 30 episodes."""
    from services.cli.experiment.files import write_founding_files
    from sfid_core.experiments import figure2 as experiment
    from sfid_core.experiments.intervals import Resampling
    from sfid_core.experiments.summary import summarise

    numbers = seed_range(seed, seeds)
    conditions = experiment.conditions(world_spec(level, starts))
    results, seconds, sha256 = run_all(conditions, numbers, workers, out, plain=no_compile)
    arms = [experiment.arm(*pair) for pair in zip(conditions, results, strict=True)]
    resampling = Resampling(seed=seed)
    summaries = summarise(arms, resampling)
    claims = experiment.claims(arms, resampling)
    files = []
    if out is not None:
        optimum = experiment.optimal_steps(results)
        files = write_founding_files(out, arms, summaries, claims, numbers, optimum)
    if as_json:
        document: dict[str, Any] = {
            "seeds": seeds,
            "seconds": seconds,
            "sha256": sha256,
            "conditions": [summary.document() for summary in summaries],
            "claims": [claim.document() for claim in claims],
            "files": [str(path) for path in files],
        }
        print_json(document)
        return
    console = Console()
    print_whole(arm_table(summaries), console)
    print_findings(console, claims, files)


def arm_table(summaries: Sequence[ArmSummary]) -> Table:
    """Return the first and the last five episodes of each arm, and what the teaching cost."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("method")
    table.add_column("teacher")
    for name in ("steps, first 5", "last 5", "solved, last 5", "inputs", "time s", "agreed after"):
        table.add_column(name, justify="right")
    for summary in summaries:
        steps, solved = summary.means[Measure.STEPS], summary.means[Measure.SOLVED]
        table.add_row(
            summary.method,
            summary.teacher,
            f"{steps[:5].mean():.1f}",
            f"{steps[-5:].mean():.1f}",
            f"{solved[-5:].mean():.0%}",
            f"{summary.totals['inputs_total'][0]:.0f}",
            f"{summary.totals['teaching_time_s'][0]:.0f}",
            f"{summary.totals['labels_to_agreement'][0]:.0f} inputs",
        )
    return table
