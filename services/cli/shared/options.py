"""Options that several commands share, with their help."""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from services.cli.shared.failure import CommandError
from services.runtime.zenoh_config import DEFAULT_ENDPOINT
from sfid_core.learning.methods import METHODS
from sfid_core.learning.parameters import Value

Connect = Annotated[
    str,
    typer.Option(envvar="SFID_CONNECT", help="Endpoint of the router, tcp/HOST:PORT.", show_default=True),
]
Access = Annotated[
    Path | None,
    typer.Option(
        envvar="SFID_ACCESS",
        help="Directory with this role's login; default: what a router of yours on this machine has told.",
    ),
]
Deployment = Annotated[str, typer.Option(help="Name of the deployment; two on one router never meet.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout (logs go to stderr).")]
RequireTokens = Annotated[
    bool, typer.Option(help="Let nobody teach without a token of `sfid invite` with the same --data.")
]
SupervisedFd = Annotated[int | None, typer.Option(hidden=True, help="The line to a supervisor.")]
Verbose = Annotated[bool, typer.Option(help="Log more.")]
Data = Annotated[Path, typer.Option(help="Directory of the deployment's journal, logs and recordings.")]
Method = Annotated[str, typer.Option(help=f"Learning method: {', '.join(METHODS)}.")]
Parameter = Annotated[
    list[str] | None,
    typer.Option(
        "--parameter",
        "-p",
        help="A parameter of the method, NAME=VALUE; may be repeated; see `sfid methods METHOD`.",
    ),
]
Level = Annotated[
    str, typer.Option(help="A packaged level's name, or FILE[:N]: the level N (from 0) of an XSB file.")
]
Episodes = Annotated[int, typer.Option(help="Number of episodes, 1 to 1,000,000.")]
Starts = Annotated[
    str,
    typer.Option(
        help='Start states: "1" the level\'s own, a number N of drawn ones, "all", or "within:STEPS".'
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of every draw, 0 to 2^53-1.")]

DATA = Path("sfid-data/up")
"""Data directory of `sfid up`, unless told otherwise."""
ENDPOINT = DEFAULT_ENDPOINT
CONNECT_TIMEOUT_MS = 5_000
SERVICE_CONNECT_TIMEOUT_MS = 30_000
"""Services wait longer for their router than people do: in a container they start side by side."""


def given_parameters(written: list[str] | None) -> dict[str, Value]:
    """Return parameters by name from NAME=VALUE texts; a value that is a number becomes one."""
    given: dict[str, Value] = {}
    for text in written or ():
        name, equals, value = text.partition("=")
        if not equals:
            message = f"parameter {text!r} has no value: write NAME=VALUE, for example alpha=0.2"
            raise CommandError(message)
        try:
            given[name.strip()] = float(value)
        except ValueError:
            given[name.strip()] = value.strip()
    return given


def print_json(document: Any) -> None:  # noqa: ANN401 - any JSON value
    """Print one document on stdout."""
    json.dump(document, sys.stdout, ensure_ascii=False)
    sys.stdout.write("\n")
    sys.stdout.flush()
