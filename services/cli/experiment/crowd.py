"""`sfid experiment crowd`: how many teachers of which quality an agent needs."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from services.cli.experiment.shared import (
    Out,
    Seeds,
    print_findings,
    runner_config,
    seed_range,
    world_spec,
)
from services.cli.shared.failure import CommandError
from services.cli.shared.options import Json, Level, Seed, print_json
from services.cli.shared.progress import progress
from services.cli.shared.tables import print_whole
from sfid_core.crowd.settings import CrowdMethod, CrowdSettings, crowd_method
from sfid_core.experiments.claims import Claim
from sfid_core.experiments.crowd import CrowdCondition
from sfid_core.experiments.summary import Arm, ArmSummary

ALONE, MIXED = "alone", "30 % random"
SHORT = {ALONE: "", MIXED: ", random too"}
RECORDED = {"success": "Solved after 30 episodes", "accuracy": "Crowd's answers right", "labels": "Labels"}
"""Totals that the recording shows, and how its plots are called."""


def add_to(app: typer.Typer) -> None:
    """Add the experiment."""
    app.command()(crowd)


def crowd(  # noqa: PLR0917 - one argument a flag
    seeds: Seeds = 100,
    seed: Seed = 0,
    mix: Annotated[
        list[str] | None,
        typer.Option(
            help="A crowd, KIND:COUNT or KIND@ACCURACY:COUNT by comma, as of `teach crowd`; may be repeated. "
            "Each is run without its random members too. Default: 1 to 20 members of three qualities."
        ),
    ] = None,
    method: Annotated[
        str, typer.Option(help=f"How answers are weighed: {', '.join(CrowdMethod)}.")
    ] = CrowdMethod.ONE_COIN.value,
    solver: Annotated[
        bool, typer.Option(help="Let naming another optimal action cost nothing, as a live crowd does.")
    ] = True,
    level: Level = "room",
    starts: Annotated[
        str, typer.Option(help='Where episodes start: "all", a number N, or "within:STEPS".')
    ] = "all",
    out: Out = None,
    workers: Annotated[int, typer.Option(help="Processes; 0: one a core.")] = 0,
    as_json: Json = False,
) -> None:
    """How many teachers of which quality an agent needs, and what random answers among theirs cost."""
    from sfid_core.experiments import crowd as experiment
    from sfid_core.experiments.intervals import Resampling
    from sfid_core.experiments.summary import summarise

    numbers, world = seed_range(seed, seeds), world_spec(level, starts)
    weighing = CrowdSettings(method=crowd_method(method))
    made = experiment.compared(mix, world, weighing, solver=solver) if mix else ()
    conditions = made or experiment.sweep(world, weighing, solver=solver)
    began = time.perf_counter()
    results = _run(conditions, numbers, workers, out)
    seconds = time.perf_counter() - began
    arms = [experiment.arm(*pair) for pair in zip(conditions, results, strict=True)]
    resampling = Resampling(seed=seed)
    summaries = summarise(arms, resampling)
    claims = experiment.claims(arms, resampling, None if mix else experiment.RANDOM_SHARE)
    files = [] if out is None else _write_files(out, arms, summaries, claims, numbers, conditions)
    if as_json:
        head = {"seeds": seeds, "seconds": seconds, "method": method, "solver": solver}
        print_json(head | _document(conditions, results, summaries, claims, files))
        return
    console = Console()
    print_whole(crowd_table(summaries), console)
    print_findings(console, claims, files)


def _run(
    conditions: Sequence[CrowdCondition], seeds: Sequence[int], workers: int, out: Path | None
) -> list[Any]:
    from services.experiments.runner import run_conditions

    config = runner_config(conditions, seeds, workers, out, fast=False)
    with progress("seeds") as told:
        return run_conditions(conditions, seeds, config, told)


def _document(
    conditions: Sequence[CrowdCondition],
    results: list[Any],
    summaries: Sequence[ArmSummary],
    claims: Sequence[Claim],
    files: Sequence[Path],
) -> dict[str, Any]:
    from sfid_core.experiments.condition import results_sha256

    return {
        "sha256": results_sha256(results),
        "crowds": [_crowd(*pair) for pair in zip(conditions, summaries, strict=True)],
        "claims": [claim.document() for claim in claims],
        "files": [str(path) for path in files],
    }


def _crowd(condition: CrowdCondition, summary: ArmSummary) -> dict[str, Any]:
    from sfid_core.experiments.crowd import random_share

    document: dict[str, Any] = {"mix": condition.mix, "random_share": random_share(condition.mix)}
    if condition.size:
        document |= {"quality": condition.quality, "size": condition.size}
    return document | {name: [mean, *ci] for name, (mean, ci) in summary.totals.items()}


def crowd_table(summaries: Sequence[ArmSummary]) -> Table:
    """Return a row for every crowd."""
    title = "solved: by the learnt policy alone after 30 episodes; right: the crowd's answers"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("crowd", no_wrap=True)
    for name in ("solved", "interval", "right", "spoke", "labels", "inputs"):
        table.add_column(name, justify="right")
    for summary in summaries:
        mean, interval = summary.totals["success"]
        told = {name: total for name, (total, _) in summary.totals.items()}
        table.add_row(
            summary.teacher,
            f"{mean:.2f}",
            f"{interval.lo:.2f} to {interval.hi:.2f}",
            f"{told['accuracy']:.1%}",
            f"{told['spoken']:.0%}",
            f"{told['labels']:,.0f}",
            f"{told['inputs']:,.0f}",
        )
    return table


def _write_files(
    folder: Path,
    arms: Sequence[Arm],
    summaries: Sequence[ArmSummary],
    claims: Sequence[Claim],
    seeds: Sequence[int],
    conditions: Sequence[CrowdCondition],
) -> list[Path]:
    from services.exports.experiment_tables import claim_table, seed_table
    from services.exports.table import Column, ExportError, Kind
    from services.exports.write import write_tables
    from services.plots.figures import write_curves, write_dots
    from services.plots.model import PlotError, Width

    explained = {
        "success": Column("success", Kind.NUMBER, "Share of starts that the learnt policy alone solves."),
        "solved": Column("solved", Kind.NUMBER, "Share of the last five episodes that were solved."),
        "inputs": Column("inputs", Kind.WHOLE, "Answers of the crowd that the agent learnt from.", "answers"),
        "labels": Column("labels", Kind.WHOLE, "Labels that the members gave.", "labels"),
        "accuracy": Column("accuracy", Kind.NUMBER, "Share of the crowd's answers that are optimal actions."),
        "spoken": Column("spoken", Kind.NUMBER, "Share of decisions to which the crowd gave an answer."),
    }
    about = f"sfid experiment crowd, {len(seeds)} seeds from {seeds[0]}, simulated members"
    note = f"Means over {len(seeds):,} seeds with 95 % intervals; simulated members."
    try:
        tables = write_tables(folder, about, (seed_table(arms, seeds, explained), claim_table(claims)))
        if conditions[0].size:
            drawn = write_curves(_panels(conditions, summaries), folder / "crowd", note, Width.PAGE)
        else:
            drawn = write_dots([_grid(summaries)], folder / "crowd", note)
    except (ExportError, PlotError) as error:
        raise CommandError(str(error)) from None
    return [*tables, *drawn, _record(folder / "crowd.rrd", conditions, summaries)]


def _record(path: Path, conditions: Sequence[CrowdCondition], summaries: Sequence[ArmSummary]) -> Path:
    """Write what the crowds come to by the number of their members, a line a kind of crowd."""
    from services.monitor.config import MonitorError
    from services.monitor.experiment_recording import Course, record_courses

    sized = bool(conditions[0].size)
    points: dict[tuple[str, str], list[tuple[float, ...]]] = {}
    for number, (condition, summary) in enumerate(zip(conditions, summaries, strict=True)):
        company = MIXED if "random" in condition.mix else ALONE
        name = f"{condition.quality} {company}" if sized else summary.teacher
        for total, title in RECORDED.items():
            mean, ci = summary.totals[total]
            points.setdefault((title, name), []).append((condition.size if sized else number, mean, *ci))
    courses = [
        Course(plot, name, at.astype(np.int64), mean, lo, hi)
        for (plot, name), rows in points.items()
        for at, mean, lo, hi in (np.array(rows, dtype=np.float64).T,)
    ]
    try:
        return record_courses(path, courses, "members" if sized else "crowd")
    except MonitorError as error:
        raise CommandError(str(error)) from None


def _panels(conditions: Sequence[CrowdCondition], summaries: Sequence[ArmSummary]) -> list[Any]:
    """Return what the learnt policy solves, and how often the crowd is right, by members who look."""
    from services.plots.model import Panel

    x_label = "Members who look"
    shown = {"success": "(a) Solved after 30 episodes", "accuracy": "(b) Crowd's answers right"}
    return [
        Panel(title, _lines(conditions, summaries, total), x_label, from_zero=total == "success")
        for total, title in shown.items()
    ]


def _lines(
    conditions: Sequence[CrowdCondition], summaries: Sequence[ArmSummary], total: str
) -> tuple[Any, ...]:
    from services.plots.model import Line

    qualities = list(dict.fromkeys(condition.quality for condition in conditions))
    points: dict[tuple[str, str], list[tuple[float, ...]]] = {}
    for condition, summary in zip(conditions, summaries, strict=True):
        company = MIXED if "random" in condition.mix else ALONE
        mean, ci = summary.totals[total]
        points.setdefault((condition.quality, company), []).append((condition.size, mean, *ci))
    return tuple(
        Line(quality + SHORT[company], size, mean, lo, hi, qualities.index(quality), int(company == MIXED))
        for (quality, company), rows in points.items()
        for size, mean, lo, hi in (np.array(rows, dtype=np.float64).T,)
    )


def _grid(summaries: Sequence[ArmSummary]) -> Any:  # noqa: ANN401 - a Grid, loaded late
    from services.plots.model import Grid

    told = [summary.totals["success"] for summary in summaries]
    cells = np.array([(mean, *ci) for mean, ci in told], dtype=np.float64)
    rows = tuple(summary.teacher for summary in summaries)
    title = "Solved after 30 episodes"
    return Grid(title, rows, ("success",), cells[:, :1], cells[:, 1:2], cells[:, 2:])
