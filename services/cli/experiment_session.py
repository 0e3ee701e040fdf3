"""`sfid experiment session`: one session's configuration over many seeds, with simulated teachers."""

from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from services.cli.experiment_shared import (
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
from services.cli.options import (
    Episodes,
    Json,
    Level,
    Method,
    Parameter,
    Seed,
    Starts,
    given_parameters,
    print_json,
)
from sfid_core.experiments.summary import ArmSummary, Measure


def add_to(app: typer.Typer) -> None:
    """Add the experiment."""
    app.command()(session)


def session(  # noqa: PLR0917 - one argument a flag
    level: Level = "room",
    method: Method = "sfid",
    teacher: Annotated[str, typer.Option(help="Simulated teachers by comma; or none.")] = "expert",
    episodes: Episodes = 30,
    starts: Starts = "4",
    parameter: Parameter = None,
    name: Annotated[str, typer.Option(help="Name of the session: it names the draws.")] = "demo",
    seeds: Seeds = 100,
    seed: Seed = 0,
    out: Out = None,
    workers: Workers = 0,
    no_compile: Plain = False,
    as_json: Json = False,
) -> None:
    """A session's configuration (flags as of `session create`) over many seeds: its measures by episode."""
    from services.cli.experiment_files import write_curve_files
    from sfid_core.experiments.condition import Condition, arm_of
    from sfid_core.experiments.intervals import Resampling
    from sfid_core.experiments.summary import summarise
    from sfid_core.session.config import SessionConfig
    from sfid_core.teaching.personas import PERSONAS, persona_named

    numbers = seed_range(seed, seeds)
    people = () if teacher == "none" else named(teacher, "teacher", tuple(PERSONAS))
    world = world_spec(level, starts)
    config = SessionConfig(name, world, method, given_parameters(parameter), episodes)
    condition = Condition(teacher, config, {one: persona_named(one) for one in people})
    run = run_all([condition], numbers, workers, out, plain=no_compile)
    arms = [arm_of(condition, run.results[0])]
    (summary,) = summarise(arms, Resampling(seed=seed))
    files = [] if out is None else write_curve_files(out, arms, [summary], numbers)
    if as_json:
        document: dict[str, Any] = {"seconds": run.seconds, "sha256": run.sha256} | summary.document()
        print_json(document | {"files": [str(path) for path in files]})
        return
    console = Console()
    console.print(episode_table(summary))
    print_findings(console, (), files)


def episode_table(summary: ArmSummary) -> Table:
    """Return the means of each episode over the seeds, steps with their interval; of many, some."""
    title = f"{summary.method}, {summary.teacher}, {summary.n_seeds} seeds"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for column in ("episode", "steps", "interval", "solved", "|TD error|", "return", "inputs"):
        table.add_column(column, justify="right", no_wrap=True)
    means, n_episodes = summary.means, len(summary.means[Measure.STEPS])
    for episode in range(0, n_episodes, max(1, n_episodes // 30)):
        lo, hi = summary.intervals[Measure.STEPS][episode]
        table.add_row(
            str(episode + 1),
            f"{means[Measure.STEPS][episode]:.1f}",
            f"{lo:.1f} to {hi:.1f}",
            f"{means[Measure.SOLVED][episode]:.0%}",
            f"{means[Measure.ABS_TD_ERROR][episode]:.2f}",
            f"{means[Measure.DISCOUNTED_RETURN][episode]:.1f}",
            f"{means[Measure.INPUTS][episode]:.1f}",
        )
    return table
