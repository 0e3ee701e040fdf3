"""`sfid aggregate`: a crowd teaches as one teacher."""

from pathlib import Path
from typing import Annotated

import typer

from services.cli.options import ENDPOINT, Connect, Deployment, Seed, SupervisedFd, Verbose
from services.cli.waiting import service_bus
from services.runtime.process import ProcessConfig, ServiceProcess
from sfid_core.crowd.round import RoundSettings
from sfid_core.crowd.settings import CrowdMethod, CrowdSettings, crowd_method

ROUNDS = RoundSettings()
WEIGHING = CrowdSettings()


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(aggregate)


def aggregate(  # noqa: PLR0917 - one argument a flag
    data: Annotated[
        Path, typer.Option(help="Directory of the deployment; the journal is in crowd-NAME below.")
    ],
    name: Annotated[str, typer.Option(help="Name under which the crowd teaches.")] = "crowd",
    session: Annotated[
        list[str] | None, typer.Option(help="Session that it may teach; may be repeated; default: any.")
    ] = None,
    crowd_deployment: Annotated[
        str | None,
        typer.Option(help="Deployment that its members use; default: the learner's name with -crowd."),
    ] = None,
    method: Annotated[
        str, typer.Option(help=f"How answers are weighed: {', '.join(CrowdMethod)}.")
    ] = WEIGHING.method.value,
    quorum: Annotated[
        int, typer.Option(help="Answers that close a decision; 0: everybody present.")
    ] = ROUNDS.quorum,
    margin_ms: Annotated[
        int, typer.Option(help="How long before the learner's deadline it closes, in ms.")
    ] = ROUNDS.margin_ms,
    patience_ms: Annotated[
        int, typer.Option(help="How long after the first answer it closes where there is no deadline, in ms.")
    ] = ROUNDS.patience_ms,
    abstain_below: Annotated[
        float, typer.Option(help="Abstain when the best action is less probable than this, 0 to 1.")
    ] = WEIGHING.abstain_below,
    forgetting: Annotated[
        float, typer.Option(help="What earlier answers keep of their weight at each further one, 0.5 to 1.")
    ] = WEIGHING.forgetting,
    influence_cap: Annotated[
        float, typer.Option(help="Share of a decision that one worker may hold, above 0, up to 1.")
    ] = WEIGHING.influence_cap,
    gold_share: Annotated[
        float,
        typer.Option(help="Share of the states with one optimal action that measure the workers, 0 to 1."),
    ] = 0.0,
    solver: Annotated[
        bool, typer.Option(help="Let naming another optimal action cost nothing, where the solver knows.")
    ] = True,
    seed: Seed = 0,
    connect: Connect = ENDPOINT,
    deployment: Deployment = "local",
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Run an aggregator: many unreliable people teach as one, and it learns whom to believe."""
    from services.aggregator.config import AggregatorConfig
    from services.aggregator.service import run
    from services.runtime.clock import SystemClock

    config = AggregatorConfig(
        data,
        name,
        deployment,
        crowd_deployment or f"{deployment}-crowd",
        tuple(session or ()),
        RoundSettings(quorum, margin_ms, patience_ms),
        CrowdSettings(
            method=crowd_method(method),
            abstain_below=abstain_below,
            forgetting=forgetting,
            influence_cap=influence_cap,
        ),
        solver=solver,
        gold_share=gold_share,
        seed=seed,
    )
    process = ServiceProcess(ProcessConfig(f"aggregator-{name}", supervised_fd, verbose))
    bus = service_bus(connect, process.stop)
    try:
        run(config, bus, SystemClock(), process.ready, process.stop)
    finally:
        bus.close()
