"""`sfid experiment session`: one session's configuration over many seeds, with simulated teachers."""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from services.cli.experiment.shared import (
    Out,
    Plain,
    Run,
    Seeds,
    Workers,
    named,
    print_findings,
    run_all,
    seed_range,
)
from services.cli.session_source import (
    DeadlockReward,
    EpisodesFlag,
    Flags,
    GoalReward,
    LevelFlag,
    MethodFlag,
    Recorded,
    StartsFlag,
    StepReward,
    StepsMax,
    chosen,
    recorded,
)
from services.cli.shared.failure import CommandError
from services.cli.shared.options import Json, Parameter, print_json
from services.cli.shared.tables import print_whole
from sfid_core.experiments.condition import Condition
from sfid_core.experiments.summary import ArmSummary, Measure
from sfid_core.teaching.personas import PERSONAS, persona_named

Source = Annotated[
    Path | None,
    typer.Option(
        "--from",
        help="Data directory of a learner: begin from the configuration of a recorded session; other flags "
        "go before it.",
    ),
]
SessionOf = Annotated[
    str | None, typer.Option("--session", help="Which session of --from; needed where it has several.")
]
TeacherFlag = Annotated[
    str | None,
    typer.Option(
        help="Simulated teachers by comma; or none. Default: those who joined and are simulated ones by "
        "their names, else expert."
    ),
]
NameFlag = Annotated[
    str | None,
    typer.Option(help="Name of the session: it names the draws. Default: the recorded one's, else demo."),
]
SeedFlag = Annotated[
    int | None, typer.Option(help="First seed, 0 to 2^53-1. Default: the recorded session's, else 0.")
]


def add_to(app: typer.Typer) -> None:
    """Add the experiment."""
    app.command()(session)


def session(  # noqa: PLR0917 - one argument a flag
    source: Source = None,
    session_name: SessionOf = None,
    level: LevelFlag = None,
    method: MethodFlag = None,
    teacher: TeacherFlag = None,
    episodes: EpisodesFlag = None,
    starts: StartsFlag = None,
    parameter: Parameter = None,
    goal_reward: GoalReward = None,
    step_reward: StepReward = None,
    deadlock_reward: DeadlockReward = None,
    steps_max: StepsMax = None,
    name: NameFlag = None,
    seeds: Seeds = 100,
    seed: SeedFlag = None,
    out: Out = None,
    workers: Workers = 0,
    no_compile: Plain = False,
    as_json: Json = False,
) -> None:
    """A session's configuration (flags as of `session create`, or a recorded one's) over many seeds.

    Its first seed with the recorded session's name and teachers is that session, if nothing but labels of
    simulated teachers decided it.
    """
    if session_name is not None and source is None:
        message = "--session names a recorded session: give its data directory with --from"
        raise CommandError(message)
    past = None if source is None else recorded(source, session_name)
    first = seed if seed is not None else (past.config.seed if past else 0)
    numbers = seed_range(first, seeds)
    flags = Flags(
        level, method, episodes, starts, parameter, goal_reward, step_reward, deadlock_reward, steps_max
    )
    condition = _condition(past, flags, first, name, teacher)
    absent = () if past is None else absent_teachers(past.teachers, condition.teachers)
    if note := replacement_note(absent, condition, teacher):
        print(note, file=sys.stderr, flush=True)
    run = run_all([condition], numbers, workers, out, plain=no_compile)
    _report(condition, run, numbers, out, absent, as_json=as_json)


def _condition(
    past: Recorded | None, flags: Flags, seed: int, name: str | None, teacher: str | None
) -> Condition:
    config = chosen(past.config if past else None, flags, seed)
    if name is not None:
        config = replace(config, session=name)
    simulated = [one for one in (past.teachers if past else ()) if one in PERSONAS]
    wanted = teacher if teacher is not None else ",".join(simulated) or "expert"
    people = () if wanted == "none" else named(wanted, "teacher", tuple(PERSONAS))
    return Condition(wanted, config, {one: persona_named(one) for one in people})


def absent_teachers(recorded_teachers: Sequence[str], taught_by: Iterable[str]) -> tuple[str, ...]:
    """Return who taught the recorded session and does not teach the experiment."""
    taught = set(taught_by)
    return tuple(one for one in recorded_teachers if one not in taught)


def replacement_note(absent: Sequence[str], condition: Condition, chosen: str | None) -> str:
    """Return who teaches in whose place, empty where nobody was replaced or --teacher has chosen."""
    if not absent or chosen is not None:
        return ""
    teachers = ", ".join(condition.teachers) or "nobody"
    return (
        f"note: {', '.join(absent)} taught the recorded session and cannot be simulated by name: here "
        f"{teachers} teaches; choose with --teacher"
    )


def _report(
    condition: Condition,
    run: Run,
    seeds: Sequence[int],
    out: Path | None,
    absent: Sequence[str],
    *,
    as_json: bool,
) -> None:
    from services.cli.experiment.files import write_curve_files
    from sfid_core.experiments.condition import arm_of
    from sfid_core.experiments.intervals import Resampling
    from sfid_core.experiments.summary import summarise

    arms = [arm_of(condition, run.results[0])]
    (summary,) = summarise(arms, Resampling(seed=seeds[0]))
    files = [] if out is None else write_curve_files(out, arms, [summary], seeds)
    if as_json:
        document: dict[str, Any] = {"seconds": run.seconds, "sha256": run.sha256} | summary.document()
        document["teachers"] = {"simulated": list(condition.teachers), "absent": list(absent)}
        print_json(document | {"files": [str(path) for path in files]})
        return
    console = Console()
    print_whole(episode_table(summary), console)
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
