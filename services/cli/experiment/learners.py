"""`sfid experiment learners`: methods by teachers on one or several levels."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from services.cli.experiment.settings import Setting, print_settings, settings_of
from services.cli.experiment.shared import (
    Out,
    Plain,
    Seeds,
    Workers,
    named,
    print_findings,
    run_all,
    seed_range,
    world_spec,
)
from services.cli.shared.options import Json, Seed, print_json
from services.cli.shared.tables import print_whole
from sfid_core.experiments.claims import Claim
from sfid_core.experiments.condition import Condition, Results
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.learners import DEADLOCK_REWARD, STEPS_MAX
from sfid_core.experiments.summary import Arm, ArmSummary

Methods = Annotated[str, typer.Option(help="Methods by comma, or all; see `sfid methods [NAME]`.")]
Teachers = Annotated[
    str, typer.Option(help="Simulated teachers by comma, or all of the table; see `sfid teachers [NAME]`.")
]


class LevelFindings(NamedTuple):
    """What one level came to."""

    level: str
    arms: list[Arm]
    summaries: tuple[ArmSummary, ...]
    claims: tuple[Claim, ...]


def add_to(app: typer.Typer) -> None:
    """Add the experiment."""
    app.command()(learners)


def learners(  # noqa: PLR0917 - one argument a flag
    seeds: Seeds = 100,
    seed: Seed = 0,
    level: Annotated[
        list[str] | None, typer.Option(help="A packaged level or FILE[:N]; may be repeated. Default: room.")
    ] = None,
    starts: Annotated[
        str, typer.Option(help='Where episodes start: "all", a number N, or "within:STEPS".')
    ] = "all",
    methods: Methods = "all",
    teachers: Teachers = "all",
    deadlock_reward: Annotated[
        float, typer.Option(help="What a deadlock costs beside the end.")
    ] = DEADLOCK_REWARD,
    steps_max: Annotated[int, typer.Option(help="Step cap of an episode, in steps.")] = STEPS_MAX,
    out: Out = None,
    workers: Workers = 0,
    no_compile: Plain = False,
    as_json: Json = False,
) -> None:
    """Methods by teachers: what the policy alone solves after 30, 100 and 300 episodes, and the answers."""
    from services.cli.experiment.files import write_learner_files
    from sfid_core.experiments import learners as experiment
    from sfid_core.learning.methods import METHODS
    from sfid_core.teaching.personas import PERSONAS

    numbers = seed_range(seed, seeds)
    known = tuple(dict.fromkeys((*experiment.VARIANTS, *METHODS)))
    rows = tuple(experiment.VARIANTS) if methods == "all" else named(methods, "method", known)
    columns = experiment.TEACHERS if teachers == "all" else named(teachers, "teacher", tuple(PERSONAS))
    levels = list(dict.fromkeys(level or ["room"]))
    worlds = [
        replace(world_spec(one, starts), deadlock_reward=deadlock_reward, steps_max=steps_max)
        for one in levels
    ]
    conditions = [one for world in worlds for one in experiment.conditions(world, rows, columns)]
    results, seconds, sha256 = run_all(conditions, numbers, workers, out, plain=no_compile)
    found = _findings(levels, conditions, results, Resampling(seed=seed))
    files = [] if out is None else write_learner_files(out, found, numbers)
    settings = _settings(rows)
    if as_json:
        print_json(_document(found, seeds, seconds, sha256, files) | {"settings": settings})
        return
    for one in found:
        console = Console()
        print_whole(learner_table(one), console)
        print_findings(console, one.claims, ())
    print_settings(Console(), settings)
    print_findings(Console(), (), files)


def _settings(rows: Sequence[str]) -> list[Setting]:
    """Return what the rows set otherwise than by default."""
    from sfid_core.experiments.learners import variant_named

    variants = [(row, variant_named(row)) for row in rows]
    return [
        setting
        for row, one in variants
        for setting in settings_of(row, one.method, one.parameters, one.teacher)
    ]


def _findings(
    levels: Sequence[str], conditions: Sequence[Condition], results: Sequence[Results], resampling: Resampling
) -> list[LevelFindings]:
    """Return what each level came to; the conditions stand level by level, equally many each."""
    from sfid_core.experiments.learners import arm, claims
    from sfid_core.experiments.summary import summarise

    found = []
    each = len(conditions) // len(levels)
    for place, name in enumerate(levels):
        part = slice(place * each, (place + 1) * each)
        arms = [arm(*pair) for pair in zip(conditions[part], results[part], strict=True)]
        found.append(LevelFindings(name, arms, summarise(arms, resampling), claims(arms, resampling)))
    return found


def _document(
    found: Sequence[LevelFindings], seeds: int, seconds: float, sha256: str, files: Sequence[Path]
) -> dict[str, Any]:
    return {
        "seeds": seeds,
        "seconds": seconds,
        "sha256": sha256,
        "cells": [_cell(one.level, summary) for one in found for summary in one.summaries],
        "claims": [{"level": one.level} | claim.document() for one in found for claim in one.claims],
        "files": [str(path) for path in files],
    }


def _cell(level: str, summary: ArmSummary) -> dict[str, Any]:
    from sfid_core.experiments.learners import CHECKPOINTS, total_name

    def with_interval(what: str, episodes: int) -> list[float]:
        mean, interval = summary.totals[total_name(what, episodes)]
        return [mean, *interval]

    return {
        "method": summary.method,
        "teacher": summary.teacher,
        "level": level,
        "success": {str(episodes): with_interval("success", episodes) for episodes in CHECKPOINTS},
        "inputs": with_interval("inputs", CHECKPOINTS[-1]),
        "steps": with_interval("steps", CHECKPOINTS[-1]),
    }


def learner_table(found: LevelFindings) -> Table:
    """Return methods by teachers: success after 30, 100 and 300 episodes, and the answers in thousands."""
    from sfid_core.experiments.learners import CHECKPOINTS, total_name

    title = f"{found.level}: share solved after 30/100/300 episodes, answers in thousands"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    teachers = list(dict.fromkeys(summary.teacher for summary in found.summaries))
    table.add_column("method", no_wrap=True)
    for teacher in teachers:
        table.add_column(teacher, no_wrap=True)
    cells = {(summary.method, summary.teacher): summary.totals for summary in found.summaries}
    for method in dict.fromkeys(summary.method for summary in found.summaries):
        row = []
        for teacher in teachers:
            totals = cells[method, teacher]
            shares = "/".join(f"{totals[total_name('success', episodes)][0]:.2f}" for episodes in CHECKPOINTS)
            row.append(f"{shares} {totals[total_name('inputs', CHECKPOINTS[-1])][0] / 1000:.1f}k")
        table.add_row(method, *row)
    return table
