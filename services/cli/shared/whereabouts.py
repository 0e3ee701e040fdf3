"""Where a deployment's router is, for the commands that others are told, noted by `sfid up`."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from protocol.keys import checked
from services.cli.shared.failure import CommandError
from services.cli.shared.next_command import DEPLOYMENT
from services.cli.shared.options import ENDPOINT
from services.runtime.bus import BusError
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


class _Note(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    connect: str
    deployment: str


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

    Raises: BusError or KeyNameError when what is given is malformed, CommandError when what is noted is.
    """
    if connect is not None:
        split_endpoint(connect)
    if deployment is not None:
        checked(deployment, "deployment")
    if connect is not None and deployment is not None:
        return Whereabouts(connect, deployment)
    noted = _noted(data / NOTE)
    return Whereabouts(connect or noted.connect, deployment or noted.deployment)


def _noted(path: Path) -> Whereabouts:
    try:
        note = msgspec.json.decode(path.read_bytes(), type=_Note)
        split_endpoint(note.connect)
        return Whereabouts(note.connect, checked(note.deployment, "deployment"))
    except FileNotFoundError:  # `sfid up` has not been here
        return Whereabouts()
    except OSError as error:
        raise _damaged(path, error.strerror or str(error)) from None
    except (msgspec.MsgspecError, ValueError, RecursionError, BusError) as error:
        raise _damaged(path, str(error)) from None


def _damaged(path: Path, reason: str) -> CommandError:
    return CommandError(
        f"{path} does not say where the router is ({reason[:200]}): remove it and start `sfid up` again, or "
        "give --connect and --deployment"
    )
