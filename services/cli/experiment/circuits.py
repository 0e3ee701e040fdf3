"""`sfid experiment circuits`: where praise for walking round is worth more than finishing, and the cures."""

from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from services.cli.experiment.settings import print_settings, settings_of
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
from services.cli.shared.options import Json, Seed, print_json
from services.cli.shared.tables import print_whole
from sfid_core.experiments.summary import ArmSummary
from sfid_core.session.config import WorldSpec


def add_to(app: typer.Typer) -> None:
    """Add the experiment."""
    app.command()(circuits)


def circuits(
    seeds: Seeds = 100,
    seed: Seed = 0,
    level: Annotated[
        list[str] | None, typer.Option(help="A packaged level or FILE[:N]; may be repeated. Default: room.")
    ] = None,
    out: Out = None,
    workers: Workers = 0,
    no_compile: Plain = False,
    as_json: Json = False,
) -> None:
    """Positive reward circuits: the goal reward that rules them out, and what cures a trapped learner."""
    from services.cli.experiment.files import Dots, write_total_files
    from services.plots.figures import total_grid
    from sfid_core.experiments import circuits as experiment
    from sfid_core.experiments.intervals import Resampling
    from sfid_core.experiments.learners import arm
    from sfid_core.experiments.summary import summarise

    numbers = seed_range(seed, seeds)
    worlds = {name: world_spec(name, "all") for name in dict.fromkeys(level or ["room"])}
    minima = [row for name, world in worlds.items() for row in _minima(name, world)]
    conditions = experiment.conditions(next(iter(worlds.values())))
    run = run_all(conditions, numbers, workers, out, plain=no_compile, warned=False)
    arms = [arm(*pair) for pair in zip(conditions, run.results, strict=True)]
    resampling = Resampling(seed=seed)
    summaries, claims = summarise(arms, resampling), experiment.claims(arms, resampling)
    files = []
    if out is not None:
        grid = total_grid(summaries, f"success_{experiment.EPISODES}", "Share of the starts solved")
        dots = [Dots("circuits", grid, (0.0, 1.0))]
        files = write_total_files(out, "circuits", arms, claims, numbers, dots)
    settings = [
        one for case in experiment.CASES for one in settings_of(case.name, case.method, case.parameters)
    ]
    if as_json:
        print_json({
            "seeds": seeds, "seconds": run.seconds, "sha256": run.sha256, "minima": minima,
            "cases": [_case(summary, case) for summary, case in
                      zip(summaries, experiment.CASES, strict=True)],
            "settings": settings, "claims": [claim.document() for claim in claims],
            "files": [str(path) for path in files],
        })  # fmt: skip
        return
    console = Console()
    print_whole(minimum_table(minima), console)
    print_whole(case_table(summaries), console)
    print_settings(console, settings)
    print_findings(console, claims, files)


def _minima(name: str, world: WorldSpec) -> list[dict[str, Any]]:
    """Return the least goal reward of one level for every discount and way to pay an answer."""
    from sfid_core.experiments.circuits import (
        GAMMAS,
        OMEGAS,
        SMALL_GOAL,
        Accepts,
        bound,
        goal_reward_min,
        share_with,
    )
    from sfid_core.experiments.condition import tables_of

    tables = tables_of(world)
    return [
        {"level": name, "gamma": gamma, "omega": omega,
         "goal_reward_min": goal_reward_min(tables, paid, gamma), "bound": bound(paid[0], 0.0, gamma),
         "finishing_at_goal_1": {one.value: share_with(tables, paid, gamma, SMALL_GOAL, one)
                                 for one in Accepts}}
        for gamma in GAMMAS
        for omega, paid in OMEGAS.items()
    ]  # fmt: skip


def _case(summary: ArmSummary, case: Any) -> dict[str, Any]:  # noqa: ANN401 - circuits.Case, loaded late
    from sfid_core.experiments.circuits import EPISODES, TEACHER

    success, interval = summary.totals[f"success_{EPISODES}"]
    inputs, inputs_ci = summary.totals[f"inputs_{EPISODES}"]
    return {
        "case": case.name, "method": case.method, "parameters": dict(case.parameters),
        "goal_reward": case.goal_reward, "step_reward": case.step_reward, "teacher": TEACHER,
        "success": [success, *interval], "inputs": [inputs, *inputs_ci], "trapped": interval.hi < 0.5,
    }  # fmt: skip


def minimum_table(minima: list[dict[str, Any]]) -> Table:
    """Return the least goal rewards, exact to the precision of the search, and who finishes at 1."""
    from sfid_core.experiments.circuits import Accepts

    title = (
        "least goal reward with which the best policy finishes from every state, and from how many it does "
        "at goal reward 1, by what the teacher holds right"
    )
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    shares = [accepts.value for accepts in Accepts]
    for name in ("level", "gamma", "an answer pays", "needed", "bound", *shares):
        table.add_column(name, justify="left" if name in {"level", "an answer pays"} else "right")
    for row in minima:
        needed, bound = f"{row['goal_reward_min']:.1f}", f"{row['bound']:.0f}"
        finishing = [f"{row['finishing_at_goal_1'][name]:.0%}" for name in shares]
        table.add_row(row["level"], f"{row['gamma']:g}", row["omega"], needed, bound, *finishing)
    return table


def case_table(summaries: tuple[ArmSummary, ...]) -> Table:
    """Return what greedy learning comes to with a teacher who praises and seldom blames."""
    from sfid_core.experiments.circuits import EPISODES

    title = f"greedy learning, a teacher who praises and seldom blames: solved after {EPISODES} episodes"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("case")
    for name in ("solved", "interval", "answers"):
        table.add_column(name, justify="right")
    for summary in summaries:
        success, interval = summary.totals[f"success_{EPISODES}"]
        inputs = summary.totals[f"inputs_{EPISODES}"][0]
        edges = f"{interval.lo:.2f} to {interval.hi:.2f}"
        table.add_row(summary.method, f"{success:.2f}", edges, f"{inputs:,.0f}")
    return table
