"""`sfid up`: a supervised set of services."""

import logging
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from services.cli.config_keys import show_keys
from services.cli.shared import launch
from services.cli.shared.failure import CommandError
from services.cli.shared.next_command import suggested
from services.cli.shared.waiting import stoppable
from services.cli.shared.whereabouts import note_whereabouts
from services.runtime.config import Config, ConfigError, read_config
from services.runtime.endpoint import is_loopback
from services.runtime.log_config import configure
from services.runtime.signals import Stop

log = logging.getLogger("sfid.up")
CHECK_S = 0.2
RequireTokens = Annotated[
    bool | None,
    typer.Option(
        help="Let nobody teach without a token of `sfid keys new`; overrides the file; default: where other "
        "machines reach the router."
    ),
]


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(up)


def up(
    config: Annotated[Path | None, typer.Option(help="TOML file; --keys shows its keys.")] = None,
    data: Annotated[Path | None, typer.Option(help="Data directory; overrides the file.")] = None,
    listen: Annotated[str | None, typer.Option(help="Endpoint of the router; overrides the file.")] = None,
    viewer: Annotated[
        bool | None,
        typer.Option(
            help="Serve Rerun viewers, at the ports below [monitor] in the file; overrides the file."
        ),
    ] = None,
    gateway: Annotated[
        bool | None, typer.Option(help="Serve the teaching page for browsers; overrides the file.")
    ] = None,
    crowd: Annotated[
        bool | None, typer.Option(help="Let a crowd teach as one teacher; overrides the file.")
    ] = None,
    require_tokens: RequireTokens = None,
    _keys: Annotated[
        bool,
        typer.Option(
            "--keys",
            callback=show_keys,
            is_eager=True,
            help="Start nothing: print a file of all keys at their defaults, with what each means and takes.",
        ),
    ] = False,
) -> None:
    """Run router, environment, learner, monitor, gateway and crowd as asked; revive what dies."""
    try:
        settings = Config() if config is None else read_config(config)
    except ConfigError as error:
        raise CommandError(str(error)) from None
    deployed = launch.Deployed(
        data or Path(settings.data), listen or settings.listen, settings.deployment,
        asks_for_tokens(settings, listen, require_tokens),
    )  # fmt: skip
    try:
        launch.make_directories(deployed.data)
    except OSError as error:
        message = f"{deployed.data}: {error.strerror or error}: name a --data directory that can be written"
        raise CommandError(message) from None
    configure("up")
    with suppress(KeyboardInterrupt), stoppable() as stop:  # being stopped is how it ends well
        _run(deployed, settings, stop, viewer=viewer, gateway=gateway, crowd=crowd)


def asks_for_tokens(settings: Config, listen: str | None, said: bool | None) -> bool:
    """Return whether teachers must have tokens: as said, else where other machines reach the router."""
    if said is None:
        said = settings.require_tokens
    return not is_loopback(listen or settings.listen) if said is None else said


def told(deployed: launch.Deployed, details: Mapping[str, str], *, crowd: bool) -> list[str]:
    """Return what is said once everything runs: where it is and what to do next, ready to be pasted.

    Args: details: addresses by service; empty where the log has just told them at the same terminal.
    """
    at, name = deployed.endpoint, deployed.deployment
    lines = [f"router at {at}, data in {deployed.data}"]
    lines += [details[service] for service in ("monitor", "gateway") if details.get(service)]
    if crowd:
        member = suggested("teach keyboard --session NAME", at, deployed.of_the_crowd.deployment)
        lines.append(f"members of the crowd teach with {member}")
    created = suggested("session create NAME", at, name)
    teaches = suggested("teach keyboard --session NAME", at, name)
    if deployed.require_tokens:
        tokens = suggested("keys new PERSON --session NAME", data=deployed.data)
        lines.append(f"next: {created}, then {tokens}, whose file goes to {teaches[:-1]} --token-file FILE`")
    else:
        lines.append(f"next: {created}, then {teaches}")
    return lines


def _run(
    deployed: launch.Deployed,
    settings: Config,
    stop: Stop,
    *,
    viewer: bool | None,
    gateway: bool | None,
    crowd: bool | None,
) -> None:
    supervisor = launch.supervise(deployed.data, None, stop)
    try:
        supervisor.start(launch.router(deployed))
        note_whereabouts(deployed.data, deployed.endpoint, deployed.deployment)
        services = [launch.environment(deployed), *launch.learners(deployed, settings.learner.shards)]
        with_crowd = settings.aggregator.enabled if crowd is None else crowd
        section = settings.monitor
        if section.enabled:
            ports = (section.scene_port, section.curves_port, section.web_port)
            shown = section.viewer if viewer is None else viewer
            services.append(launch.monitor(deployed, viewer=shown, ports=ports, crowd=with_crowd))
        if with_crowd:
            services.append(launch.aggregator(deployed, settings.aggregator))
        if settings.gateway.enabled if gateway is None else gateway:
            services.append(launch.gateway(deployed, settings.gateway))
        details = supervisor.start(*services)
        in_log = sys.stdout.isatty() and sys.stderr.isatty() and log.isEnabledFor(logging.INFO)
        for line in told(deployed, {} if in_log else details, crowd=with_crowd):
            print(line, flush=True)
        while True:
            supervisor.check()
            stop.pause(CHECK_S)
    finally:
        supervisor.stop()
