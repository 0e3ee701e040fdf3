"""`sfid metrics`: counts of a deployment for Prometheus."""

import threading
from typing import Annotated

import typer

from protocol.keys import Keys, checked
from services.cli.shared.failure import BAD_USAGE, CommandError
from services.cli.shared.options import ENDPOINT, Access, Connect, Deployment, SupervisedFd, Verbose
from services.cli.shared.waiting import service_bus
from services.operations.status import Board, Found
from services.runtime.process import ProcessConfig, ServiceProcess
from services.topology import CROWD, Role

LOOPBACK = {"127.0.0.1", "localhost", "::1"}


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(metrics)


def metrics(
    listen: Annotated[
        str, typer.Option(help="HOST:PORT of the page /metrics; port 0 takes a free one.")
    ] = "127.0.0.1:9464",
    connect: Connect = ENDPOINT,
    access: Access = None,
    deployment: Deployment = "local",
    insecure_bind: Annotated[
        bool,
        typer.Option(help="Serve where other machines reach it, although nobody is asked for a password."),
    ] = False,
    verbose: Verbose = False,
    supervised_fd: SupervisedFd = None,
) -> None:
    """Serve counts of a deployment for Prometheus; it asks the services whenever it is asked."""
    host, port = _place(listen, insecure_bind=insecure_bind)
    try:
        from services.operations.metrics import Exporter
    except ImportError:
        message = "prometheus-client is not installed: pip install -e '.[metrics]'"
        raise CommandError(message, BAD_USAGE) from None
    checked(deployment, "deployment")
    process = ServiceProcess(ProcessConfig("metrics", supervised_fd, verbose))
    bus = service_bus(connect, process.stop, Role.OPERATOR, access)
    lock = threading.Lock()

    board = Board(bus, (Keys(deployment), Keys(f"{deployment}{CROWD}")))

    def ask_all() -> list[Found]:
        with lock:  # two scrapes at once ask one after the other
            return board.survey(("environment", "learner"))

    try:
        try:
            exporter = Exporter(host, port, ask_all)
        except OSError as error:
            message = f"cannot listen at {listen}: {error.strerror}: stop the other program or pass --listen"
            raise CommandError(message) from None
        process.ready(f"http://{host}:{exporter.port}/metrics")
        process.stop.wait()
        exporter.close()
    finally:
        bus.close()


def _place(listen: str, *, insecure_bind: bool) -> tuple[str, int]:
    host, colon, port = listen.rpartition(":")
    if not (colon and host and port.isascii() and port.isdigit() and int(port) < 65_536):
        raise CommandError(f"--listen {listen!r} is not of the form HOST:PORT, as in 127.0.0.1:9464")
    if host not in LOOPBACK and not insecure_bind:
        message = f"{listen} can be reached from other machines and asks nobody for a password: "
        raise CommandError(message + "listen at 127.0.0.1, or pass --insecure-bind")
    return host, int(port)
