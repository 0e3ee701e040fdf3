"""`sfid levels`: what levels there are, whether they can be solved and how, and new ones."""

import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer

from services.cli.level_rows import (
    Row,
    checked,
    described,
    ended,
    line,
    refuse_when_nothing_is_read,
    solved,
    tracked,
)
from services.cli.session import SEED_MAX
from services.cli.shared.failure import OK, CommandError
from services.cli.shared.level_files import Listed, find_level, find_levels
from services.cli.shared.options import Json, Seed, print_json
from sfid_core.sokoban.board import Level
from sfid_core.sokoban.generator import Recipe, generate
from sfid_core.sokoban.levels import collection, packaged_levels

__all__ = ["add_to", "find_level"]

LEVELS_MAX = 1_000

_SIZE = re.compile(r"([0-9]{1,4})x([0-9]{1,4})")

levels_app = typer.Typer(
    help="Sokoban levels: what there is, whether and how it can be solved, and new ones.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
Levels = Annotated[
    str, typer.Argument(help="A packaged set or a file (XSB, .sok, Boxoban); NAME:N is its level N, from 0.")
]
Listing = Annotated[str | None, typer.Argument(help="A packaged set or a file; every set without it.")]
NewFile = Annotated[Path | None, typer.Argument(help="A new file for the levels; stdout without it.")]


def add_to(app: typer.Typer) -> None:
    """Add the level commands."""
    app.add_typer(levels_app, name="levels")


@levels_app.command("list")
def list_levels(levels: Listing = None, json: Json = False) -> int:
    """List the levels of a file, or all that are packaged."""
    named = [levels] if levels is not None else packaged_levels()
    listed = [one for name in named for one in find_levels(name)]
    refuse_when_nothing_is_read(listed)
    rows = [{"level": one.name, **described(one)} for one in listed]
    if json:
        print_json(rows)
    else:
        print("\n".join(line(row, row["level"]) for row in rows))
    return ended(listed, rows)


@levels_app.command("show")
def show_levels(levels: Levels, json: Json = False) -> int:
    """Print levels in XSB."""
    listed = find_levels(levels)
    refuse_when_nothing_is_read(listed)
    rows = [described(one) for one in listed]
    for row, one in zip(rows, listed, strict=True):
        row["xsb"] = one.level.to_xsb() if isinstance(one.level, Level) else None
    if json:
        print_json(rows)
    else:
        drawn = (f"; {row['title'] or one.name}\n{row['xsb']}" for row, one in zip(rows, listed, strict=True))
        print("\n\n".join(text for text, row in zip(drawn, rows, strict=True) if row["xsb"]))
    return ended(listed, rows)


@levels_app.command("check")
def check_levels(levels: Levels, json: Json = False) -> int:
    """Tell whether levels can be solved, in how many steps at least, and how many states they have.

    A level that cannot be read is reported with its fault, and the others are checked all the same.
    Exit code: 0 all can be solved, 1 some cannot, 2 some cannot be read.
    """
    return _report(levels, checked, json)


@levels_app.command("solve")
def solve_levels(levels: Levels, json: Json = False) -> int:
    """Print a solution with the fewest steps there can be: l, u, r, d, and capitals for pushes.

    Exit code: 0 all are solved, 1 some have no solution, 2 some cannot be read.
    """
    return _report(levels, solved, json)


def _report(levels: str, examine: Callable[[Listed], Row], json: bool) -> int:
    listed = find_levels(levels)
    refuse_when_nothing_is_read(listed)
    rows = [examine(one) for one in tracked(listed, len(listed), "levels")]
    if json:
        print_json(rows)
    else:
        for one, row in zip(listed, rows, strict=True):
            print(line(row, one.name), *filter(None, [row.get("lurd")]), sep="\n")
    return ended(listed, rows)


@levels_app.command("generate")
def generate_levels(
    file: NewFile = None,
    size: Annotated[str, typer.Option(help="Columns x rows with the outer walls, 3 to 24 each.")] = "8x8",
    boxes: Annotated[int, typer.Option(help="Boxes, 1 to 8; each starts off the goals.")] = 2,
    steps_min: Annotated[int, typer.Option(help="Steps of a shortest solution, at least.")] = 10,
    states_max: Annotated[int, typer.Option(help="States of a level, at most.")] = 1_000_000,
    levels: Annotated[int, typer.Option(help="Number of levels, 1 to 1,000, all different.")] = 1,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Draw new levels: random rooms, each solved exactly; the same options give the same levels."""
    recipe = Recipe(*_sides(size), boxes, steps_min, states_max)
    _check_range("levels", levels, 1, LEVELS_MAX)
    _check_range("seed", seed, 0, SEED_MAX)
    made = list(tracked(islice(generate(recipe, seed), levels), levels, "levels"))
    command = (
        f"sfid levels generate --size {size} --boxes {boxes} --steps-min {steps_min} "
        f"--states-max {states_max} --levels {levels} --seed {seed}"
    )
    text = f"; {command}\n\n{collection(made)}"
    if file is not None:
        _write_new(file, text)
    if json:
        where = "generated" if file is None else str(file)
        listed = [Listed(index, level, where) for index, level in enumerate(made)]
        print_json([{**checked(one), "title": described(one)["title"], "xsb": level.to_xsb()}
                    for one, level in zip(listed, made, strict=True)])  # fmt: skip
    elif file is None:
        print(text, end="")
    else:
        print(f"{file}: {'one level' if levels == 1 else f'{levels} levels'}")
    return OK


def _sides(size: str) -> tuple[int, int]:
    found = _SIZE.fullmatch(size)
    if found is None:
        message = f"size {size!r} is no size: write columns x rows, as in 8x8"
        raise CommandError(message)
    return int(found[1]), int(found[2])


def _check_range(name: str, value: int, low: int, high: int) -> None:
    if not low <= value <= high:
        message = f"{name} {value} is outside {low} to {high}: choose another"
        raise CommandError(message)


def _write_new(file: Path, text: str) -> None:
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        message = f"{file} is there already: name a new file, or move this one away"
        raise CommandError(message) from None
    except OSError as error:
        message = f"cannot write {file}: {error.strerror or error}: name a file that can be written"
        raise CommandError(message) from None
