"""`sfid experiment figure2|...`: compare methods and teachers over many seeds."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from services.cli import experiment_learners
from services.cli.experiment_shared import (
    Out,
    Plain,
    Seeds,
    Workers,
    print_findings,
    progress,
    seed_range,
    world_spec,
)
from services.cli.options import Json, Level, Seed, Starts, print_json
from sfid_core.experiments.summary import ArmSummary, Measure

experiment_app = typer.Typer(
    help="Compare methods and teachers over many seeds.", no_args_is_help=True, rich_markup_mode=None
)


def add_to(app: typer.Typer) -> None:
    """Add the experiments."""
    experiment_learners.add_to(experiment_app)
    app.add_typer(experiment_app, name="experiment")


@experiment_app.command()
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
    from services.cli.experiment_files import check_figures, write_founding_files
    from services.experiments.runner import RunnerConfig, run_conditions
    from services.runtime.sources import keep_machine_code
    from sfid_core.experiments import figure2 as experiment
    from sfid_core.experiments.condition import results_sha256
    from sfid_core.experiments.intervals import Resampling
    from sfid_core.experiments.summary import summarise

    numbers = seed_range(seed, seeds)
    if out is not None:
        check_figures()
    keep_machine_code(Path.home() / ".cache" / "sfid")
    conditions = experiment.conditions(world_spec(level, starts))
    config = RunnerConfig(workers, False if no_compile else None, None if out is None else out / "chunks")
    began = time.perf_counter()
    with progress("seeds") as told:
        results = run_conditions(conditions, numbers, config, told)
    seconds = time.perf_counter() - began
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
            "sha256": results_sha256(results),
            "conditions": [summary.document() for summary in summaries],
            "claims": [claim.document() for claim in claims],
            "files": [str(path) for path in files],
        }
        print_json(document)
        return
    console = Console()
    console.print(arm_table(summaries))
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
