"""`sfid levels`: the packaged levels, and how a level is named on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from services.cli.failure import CommandError
from services.cli.options import Json, print_json
from sfid_core.sokoban.board import Level
from sfid_core.sokoban.levels import load_bytes, packaged, packaged_levels

levels_app = typer.Typer(
    help="Sokoban levels: what is packaged, what a file holds.", no_args_is_help=True, rich_markup_mode=None
)


def add_to(app: typer.Typer) -> None:
    """Add the level commands."""
    app.add_typer(levels_app, name="levels")


def find_level(text: str) -> tuple[str, Level]:
    """Return (name, level) for "NAME[:N]" of a packaged set or "FILE[:N]", N from 0.

    Raises: CommandError or LevelError, one line with the mend.
    """
    where, number = _split(text)
    levels = packaged(where) if where in packaged_levels() else load_bytes(_read(where), where)
    if number >= len(levels):
        message = f"{where} has {len(levels)} levels: name one from {where}:0 to {where}:{len(levels) - 1}"
        raise CommandError(message)
    level = levels[number]
    return level.title or f"{Path(where).name}:{number}", level


def _split(text: str) -> tuple[str, int]:
    where, colon, number = text.rpartition(":")
    if colon and number.isdecimal():
        return where, int(number)
    return text, 0


def _read(where: str) -> bytes:
    try:
        return Path(where).read_bytes()
    except OSError as error:
        names = ", ".join(packaged_levels())
        message = (
            f"no level {where!r}: {error.strerror or error}: name a packaged set ({names}) or a file in XSB"
        )
        raise CommandError(message) from None


@levels_app.command("list")
def list_levels(json: Json = False) -> None:
    """List the packaged levels."""
    rows = [
        {"level": f"{name}:{number}", "title": level.title, "width": level.width, "height": level.height,
         "boxes": len(level.boxes)}
        for name in packaged_levels()
        for number, level in enumerate(packaged(name))
    ]  # fmt: skip
    if json:
        print_json(rows)
        return
    for row in rows:
        print(f"{row['level']:<14} {row['width']}x{row['height']}, {row['boxes']} boxes  {row['title']}")


@levels_app.command("show")
def show_level(level: Annotated[str, typer.Argument(help="NAME[:N] or FILE[:N], N from 0.")]) -> None:
    """Print a level in XSB."""
    name, found = find_level(level)
    print(f"; {name}\n{found.to_xsb()}")
