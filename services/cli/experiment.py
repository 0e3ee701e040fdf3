"""`sfid experiment figure2|...`: compare methods and teachers over many seeds."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from services.cli.failure import CommandError
from services.cli.levels import find_level
from services.cli.options import Json, Level, Seed, Starts, print_json
from services.cli.session import SEED_MAX
from sfid_core.experiments.summary import ArmSummary, Measure
from sfid_core.session.config import WorldSpec

experiment_app = typer.Typer(
    help="Compare methods and teachers over many seeds.", no_args_is_help=True, rich_markup_mode=None
)
Seeds = Annotated[int, typer.Option(help="Number of seeds; all conditions share them.")]
Workers = Annotated[int, typer.Option(help="Threads (or processes without numba); 0: one a core.")]
Out = Annotated[
    Path | None,
    typer.Option(help="Folder for tables, figures, the recording and finished chunks (an interrupted run "
                 "with the same folder goes on)."),
]  # fmt: skip
Plain = Annotated[bool, typer.Option("--no-compile", help="Run without the compiler; the results are equal.")]


def add_to(app: typer.Typer) -> None:
    """Add the experiments."""
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
    for claim in claims:
        console.print(claim.line(), highlight=False)
    for path in files:
        console.print(f"wrote {path}", highlight=False)


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


def seed_range(first: int, count: int) -> list[int]:
    """Return the seeds first, first + 1, ...; raise with the mend when there are too few or too many."""
    if not 1 <= count <= 1_000_000:
        message = f"seeds {count} is outside 1 to 1,000,000: intervals need 10 and more"
        raise CommandError(message)
    if not 0 <= first <= SEED_MAX - count:
        message = f"seed {first} is outside 0 to 2^53-1 less the number of seeds: choose another"
        raise CommandError(message)
    return list(range(first, first + count))


def world_spec(level: str, starts: str) -> WorldSpec:
    """Return the world of an experiment: the level by name or file, our rewards."""
    title, found = find_level(level)
    return WorldSpec(found.to_xsb(), title, starts)


@contextmanager
def progress(what: str) -> Iterator[Any]:
    """Yield a function that shows how much is done, on a terminal and on stderr alone."""
    console = Console(stderr=True)
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        task = shown.add_task(what)
        yield lambda done, total: shown.update(task, completed=done, total=total)
