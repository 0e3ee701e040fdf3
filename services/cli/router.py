"""`sfid router`: run it, or tell a router of Zenoh's own how to be it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from protocol.keys import checked
from services.cli.shared.options import ENDPOINT, SupervisedFd, Verbose, print_json
from services.runtime.process import ProcessConfig, ServiceProcess

if TYPE_CHECKING:
    from services.router import RouterConfig

Listen = Annotated[
    str, typer.Option(help="Endpoint to listen at, tcp/HOST:PORT, or tls/HOST:PORT where others reach it.")
]
Links = Annotated[
    list[str] | None,
    typer.Option(help="Another router to link with, tls/HOST:PORT, now or once it is there; repeatable."),
]
Edge = Annotated[
    bool, typer.Option(help="Bring only teachers, workers and gateways to the routers linked with.")
]
Logins = Annotated[
    Path | None,
    typer.Option(
        envvar="SFID_ACCESS",
        help="Directory of the logins of all roles, made where there are none; default: one for you.",
    ),
]
Deployments = Annotated[
    list[str] | None,
    typer.Option(help="Deployment that it serves, with its crowd; may be repeated; default: local."),
]
Printed = Annotated[
    bool,
    typer.Option("--config", help="Start nothing: print the router's configuration, its rules with it."),
]
Written = Annotated[
    Path | None,
    typer.Option(help="Start nothing: write the configuration, with its login, to this file for zenohd."),
]
InsecureBind = Annotated[
    bool, typer.Option(help="Listen or link where other machines are, although nothing is encrypted.")
]
OpenToAll = Annotated[bool, typer.Option(help="Ask nobody for a login, and let everybody do anything.")]


def router(  # noqa: PLR0917 - one argument a flag
    listen: Listen = ENDPOINT,
    connect: Links = None,
    edge: Edge = False,
    access: Logins = None,
    deployment: Deployments = None,
    config: Printed = False,
    config_file: Written = None,
    insecure_bind: InsecureBind = False,
    open_to_all: OpenToAll = False,
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Run the router that all other processes connect to, and that lets each do what its role is for."""
    from services.router import RouterConfig, run
    from services.router_links import Link
    from services.runtime.machine_config import state_folder

    settings = RouterConfig(
        listen=listen,
        connect=tuple(connect or ()),
        link=Link.EDGE if edge else Link.ROUTER,
        insecure_bind=insecure_bind,
        access=None if open_to_all else access or state_folder() / "access",
        deployments=tuple(checked(name, "deployment") for name in deployment or ("local",)),
    )
    if config or config_file is not None:
        _tell(settings, config_file, printed=config)
        return
    process = ServiceProcess(ProcessConfig("router", supervised_fd, verbose))
    run(settings, lambda: process.ready(listen), process.stop)


def _tell(settings: "RouterConfig", path: Path | None, *, printed: bool) -> None:
    from services.router import written_config, zenohd_file

    if printed:
        print_json(written_config(settings))
    if path is not None:
        zenohd_file(settings, path)
