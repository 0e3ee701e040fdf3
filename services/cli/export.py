"""`sfid export`: a session's journal in a format of others."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from services.cli.failure import CommandError
from services.cli.options import Json, print_json


class Format(Enum):
    """What a session is written as."""

    RRD = "rrd"
    """A recording for the Rerun viewer."""


def add_to(app: typer.Typer) -> None:
    """Add the export command."""
    app.command()(export)


def export(
    directory: Annotated[Path, typer.Argument(help="Data directory of a learner.")],
    out: Annotated[Path, typer.Option(help="File to write; one that is there is replaced.")],
    format: Annotated[Format, typer.Option(help="What to write.")] = Format.RRD,  # noqa: A002 - the flag's name
    session: Annotated[str | None, typer.Option(help="The session; not needed where there is one.")] = None,
    deployment: Annotated[str, typer.Option(help="Deployment whose name the recording carries.")] = "local",
    json: Json = False,
) -> None:
    """Write a session from its journal alone: a recording holds what the live one holds."""
    from services.monitor.config import MonitorError
    from services.monitor.replayed import record_again

    name = _the_session(directory, session)
    try:
        written = record_again(directory, name, deployment, out)
    except MonitorError as error:
        raise CommandError(str(error)) from None
    if json:
        print_json(
            {
                "session": written.session, "format": format.value, "out": str(written.path),
                "steps": written.steps, "episodes": written.episodes,
            }
        )  # fmt: skip
    else:
        print(
            f"{written.path}: session {name}, {written.steps} steps, {written.episodes} episodes: "
            f"`rerun {written.path}` shows it"
        )


def _the_session(directory: Path, session: str | None) -> str:
    from services.monitor.replayed import journaled_sessions

    names = journaled_sessions(directory)
    if not names:
        raise CommandError(f"{directory}: no session in this journal: name the --data directory of a learner")
    if session is None and len(names) == 1:
        return names[0]
    if session in names:
        return str(session)
    shown = ", ".join(names[:10]) + (" ..." if len(names) > 10 else "")
    what = "holds several sessions" if session is None else f"no session {session}"
    raise CommandError(f"{directory}: {what}: choose one with --session: {shown}")
