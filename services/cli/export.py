"""`sfid export`: a session's journal in a format of others."""

import shlex
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from services.cli.shared.failure import CommandError
from services.cli.shared.options import Json, print_json
from services.cli.shared.recorded import no_such_session, session_names


class Format(Enum):
    """What a session is written as."""

    RRD = "rrd"
    """A recording for the Rerun viewer."""
    CSV = "csv"
    """Tidy tables with a codebook, into a directory."""
    PARQUET = "parquet"
    """The same as Parquet."""
    MINARI = "minari"
    """A data set below a directory of data sets."""
    LURD = "lurd"
    """The episodes as solutions."""
    XSB = "xsb"
    """The level and the states in which episodes began."""


def add_to(app: typer.Typer) -> None:
    """Add the export command."""
    app.command()(export)


def export(
    directory: Annotated[Path, typer.Argument(help="Data directory of a learner.")],
    out: Annotated[
        Path,
        typer.Option(help="File to write (rrd, lurd, xsb) or directory (csv, parquet, minari)."),
    ],
    format: Annotated[Format, typer.Option(help="What to write.")] = Format.RRD,  # noqa: A002 - the flag's name
    session: Annotated[str | None, typer.Option(help="The session; not needed where there is one.")] = None,
    deployment: Annotated[str, typer.Option(help="Deployment whose name the recording carries.")] = "local",
    json: Json = False,
) -> None:
    """Write a session from its journal alone: tables, a data set, levels, solutions or a recording."""
    name = _the_session(directory, session)
    if format is Format.RRD:
        steps, episodes, hint = _recording(directory, name, deployment, out)
    else:
        steps, episodes, hint = _data(directory, name, format, out)
    if json:
        print_json(
            {
                "session": name, "format": format.value, "out": str(out),
                "steps": steps, "episodes": episodes,
            }
        )  # fmt: skip
    else:
        print(f"{out}: session {name}, {steps} steps, {episodes} episodes: {hint}")


Written = tuple[int, int, str]
"""(steps, episodes, what to do with what was written)."""


def _recording(directory: Path, name: str, deployment: str, out: Path) -> Written:
    from services.monitor.config import MonitorError
    from services.monitor.replayed import record_again

    try:
        again = record_again(directory, name, deployment, out)
    except MonitorError as error:
        raise CommandError(str(error)) from None
    return again.steps, again.episodes, f"`rerun {again.path}` shows it"


def _data(directory: Path, name: str, form: Format, out: Path) -> Written:
    from services.exports.minari_data import write_minari
    from services.exports.session_story import read_story
    from services.exports.session_tables import session_tables
    from services.exports.sokoban_files import lurd_solutions, xsb_levels
    from services.exports.table import ExportError
    from services.exports.write import Format as Tables
    from services.exports.write import write_tables, write_text

    try:
        story = read_story(directory, name)
        if form in {Format.CSV, Format.PARQUET}:
            about = f"Session {name}, from its journal."
            write_tables(out, about, session_tables(story), (Tables(form.value),))
            hint = f"{out / 'codebook.md'} explains every column"
        elif form is Format.MINARI:
            write_minari(story, out)
            hint = f"minari.load_dataset('sfid/{name}-v0') reads it where MINARI_DATASETS_PATH={out}"
        else:
            text = lurd_solutions(story) if form is Format.LURD else xsb_levels(story)
            write_text(out, text)
            hint = f"`sfid levels show {shlex.quote(str(out))}` reads it"
    except ExportError as error:
        raise CommandError(str(error)) from None
    return len(story.steps), len(story.episodes), hint


def _the_session(directory: Path, session: str | None) -> str:
    names = session_names(directory)
    if session is None and len(names) == 1:
        return names[0]
    if session in names:
        return str(session)
    raise no_such_session(directory, session)
