"""Where a deployment's router is, for the commands that others are told, noted by `sfid up`."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from services.cli.next_command import DEPLOYMENT
from services.cli.options import ENDPOINT
from services.runtime.endpoint import is_loopback, reached_at, split_endpoint

NOTE = "deployment.json"
"""File of the data directory."""
ToldConnect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        envvar="SFID_CONNECT",
        help="Endpoint of the router, for printed commands; default: as `sfid up` noted it in --data.",
    ),
]
ToldDeployment = Annotated[
    str | None,
    typer.Option("--deployment", help="Name of the deployment, likewise."),
]


@dataclass(frozen=True, slots=True)
class Whereabouts:
    """The router of a deployment as its clients name it, and the deployment's name."""

    connect: str = ENDPOINT
    deployment: str = DEPLOYMENT

    @property
    def is_here(self) -> bool:
        """Whether only programs of the router's own machine reach it."""
        return is_loopback(self.connect)


def note_whereabouts(data: Path, listen: str, deployment: str) -> None:
    """Note in the data directory where the deployment's router listens. Raises: OSError."""
    path = data / NOTE
    part = path.with_suffix(".part")
    part.write_text(json.dumps({"connect": reached_at(listen), "deployment": deployment}) + "\n", "utf-8")
    part.replace(path)


def whereabouts(data: Path, connect: str | None, deployment: str | None) -> Whereabouts:
    """Return where the router is: as given, else as noted in the data directory, else at the usual place.

    Raises: BusError when the endpoint is malformed.
    """
    noted = _noted(data)
    found = Whereabouts(connect or noted.connect, deployment or noted.deployment)
    split_endpoint(found.connect)
    return found


def _noted(data: Path) -> Whereabouts:
    try:
        note = json.loads((data / NOTE).read_text("utf-8"))
        return Whereabouts(str(note["connect"]), str(note["deployment"]))
    except (OSError, ValueError, KeyError, TypeError):  # `sfid up` has not been here
        return Whereabouts()
