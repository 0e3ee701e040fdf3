"""`sfid router|environment|learner|monitor`: one service each."""

import os
from pathlib import Path
from typing import Annotated

import typer

from protocol.keys import checked
from services.cli.router import router
from services.cli.shared.failure import CommandError
from services.cli.shared.next_command import teaching
from services.cli.shared.options import (
    ENDPOINT,
    Access,
    Connect,
    Deployment,
    RequireTokens,
    SupervisedFd,
    Verbose,
)
from services.cli.shared.waiting import service_bus
from services.runtime.process import ProcessConfig, ServiceProcess
from services.topology import Role

WATCHING_YIELDS = 10
"""Niceness of the monitor: where processors are few, teaching goes first."""
Shards = Annotated[
    int,
    typer.Option(
        min=1, max=1_024, help="Shards of the data directory, shared out between as many learners; for good."
    ),
]
HomeShard = Annotated[
    int | None,
    typer.Option(min=0, help="Shard, from 0, that it begins with; without it, what no other learner holds."),
]


def add_to(app: typer.Typer) -> None:
    """Add the service commands."""
    app.command()(router)
    app.command()(environment)
    app.command()(learner)
    app.command()(monitor)


def environment(
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Run the environment: it owns the worlds and executes what learners decide."""
    from services.environment import EnvironmentConfig, run

    checked(deployment, "deployment")
    process = ServiceProcess(ProcessConfig("environment", supervised_fd, verbose))
    bus = service_bus(connect, process.stop, Role.ENVIRONMENT, access)
    try:
        run(EnvironmentConfig(deployment), bus, process.ready, process.stop)
    finally:
        bus.close()


def learner(  # noqa: PLR0917 - one argument a flag
    data: Annotated[Path, typer.Option(help="Directory of the journal; one learner, or as many as shards.")],
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    shards: Shards = 1,
    shard: HomeShard = None,
    require_tokens: RequireTokens = False,
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Run the learner: it owns sessions and their journal, opens decisions, acknowledges answers."""
    from services.learner import pool
    from services.learner.config import LearnerConfig
    from services.learner.service import run
    from services.runtime.clock import SystemClock
    from services.runtime.secret import FOLDER, load_secrets

    checked(deployment, "deployment")
    if shard is not None and shard >= shards:
        raise CommandError(f"--shard {shard}: of {shards} there are 0 to {shards - 1}: pass --shards as well")
    secrets = tuple(load_secrets(data / FOLDER))
    config = LearnerConfig(
        data, deployment, shards=shards, require_tokens=require_tokens, check_secrets=secrets
    )
    process = ServiceProcess(ProcessConfig("learner", supervised_fd, verbose))
    bus = service_bus(connect, process.stop, Role.LEARNER, access)
    try:
        if shards == 1:
            run(config, bus, SystemClock(), process.ready, process.stop)
        else:
            pool.run(config, shard, bus, SystemClock(), process.ready, process.stop)
    finally:
        bus.close()


def monitor(  # noqa: PLR0917 - one argument a flag
    recordings: Annotated[Path, typer.Option(help="Directory for the .rrd recordings.")],
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    scene_port: Annotated[
        int, typer.Option(help="Port of the picture's stream; 0 takes a free one.")
    ] = 19876,
    curves_port: Annotated[int, typer.Option(help="Port of the curves' stream; 0 takes a free one.")] = 19877,
    web_port: Annotated[int, typer.Option(help="Port of the viewer's web page; 0 takes a free one.")] = 19090,
    viewer: Annotated[bool, typer.Option(help="Serve viewers; otherwise only record.")] = True,
    insecure_bind: Annotated[
        bool, typer.Option(help="Serve on every address, although whoever reaches it can also write.")
    ] = False,
    crowd: Annotated[bool, typer.Option(help="Tell viewers also how to teach as one of the crowd.")] = False,
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Run the monitor: it draws every session for remote viewing and keeps a recording."""
    from services.monitor.service import MonitorConfig, run

    checked(deployment, "deployment")
    os.nice(WATCHING_YIELDS)
    process = ServiceProcess(ProcessConfig("monitor", supervised_fd, verbose))
    bus = service_bus(connect, process.stop, Role.MONITOR, access)
    config = MonitorConfig(
        recording_dir=recordings,
        deployment=deployment,
        scene_port=scene_port,
        curves_port=curves_port,
        web_port=web_port,
        viewer=viewer,
        insecure_bind=insecure_bind,
        teach=teaching(connect, deployment, crowd=crowd),
    )
    try:
        run(config, bus, process.ready, process.stop)
    finally:
        bus.close()
