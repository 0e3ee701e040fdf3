"""What `sfid levels` finds out about levels, as rows of JSON and as lines for people."""

import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rich.console import Console
from rich.progress import track

from services.cli.shared.failure import BAD_USAGE, NOT_SO, OK, CommandError
from services.cli.shared.level_files import Listed
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.board import Level
from sfid_core.sokoban.deadlock import surely_deadlocked
from sfid_core.sokoban.levels import LevelError
from sfid_core.sokoban.lurd import to_lurd
from sfid_core.sokoban.search import shortest
from sfid_core.sokoban.solver import solve
from sfid_core.sokoban.tables import TooManyStates, count_states

Row = dict[str, Any]
"""One level; `error` is there only when it cannot be read or solved, in one line."""

_REASONS = {
    False: "cannot be solved: no sequence of actions does it; move a box, a goal or a wall",
    None: "not known to be solvable: too many states to try them all; take away a box or some floor",
}
_NAMED_MAX = 5
"""Levels at fault that the last line names; a file may have a thousand."""


def described(one: Listed) -> Row:
    """Return what can be seen of a level without solving it; null all through when it cannot be read."""
    if isinstance(one.level, LevelError):
        return {"index": one.index, "title": None, "width": None, "height": None, "boxes": None,
                "error": str(one.level)}  # fmt: skip
    level = one.level
    return {"index": one.index, "title": level.title, "width": level.width, "height": level.height,
            "boxes": len(level.boxes)}  # fmt: skip


def checked(one: Listed) -> Row:
    """Return whether a level can be solved, in how many steps, and its states; null where that is unknown."""
    return _checked(one)[0]


def solved(one: Listed) -> Row:
    """Return the same and a shortest solution in LURD, null where there is none."""
    row, actions = _checked(one)
    row["lurd"] = None
    if isinstance(one.level, Level) and actions is not None:
        row["lurd"] = to_lurd(one.level.start, actions)
    return row


def _checked(one: Listed) -> tuple[Row, Sequence[Action] | None]:
    row = described(one)
    del row["title"]
    error = {"error": row.pop("error")} if "error" in row else {}
    row |= {"solvable": None, "optimal_steps": None, "states": None, **error}
    if not isinstance(one.level, Level):
        return row, None
    row["states"] = count_states(one.level)
    try:
        actions = _shortest(one.level)
    except TooManyStates as too_many:
        row["solvable"] = False if surely_deadlocked(one.level.start) else None
        row["error"] = f"{one.name}: {too_many}"
        return row, None
    row |= {"solvable": actions is not None, "optimal_steps": None if actions is None else len(actions)}
    return row, actions


def _shortest(level: Level) -> Sequence[Action] | None:
    """Return a shortest solution by the table of all positions, or by a search for levels beyond it."""
    try:
        solution = solve(level)
    except TooManyStates:
        return shortest(level)
    return None if solution.deadlocked(level.start) else solution.solution(level.start)


def line(row: Row, name: str) -> str:
    """Return a row for people."""
    if "error" in row:
        fault = row["error"].removeprefix(f"{name}: ").removeprefix(f"{name.rpartition(':')[0]}: ")
        return f"{name:<16} {fault}"
    parts = [f"{name:<16} {row['width']}x{row['height']}", _counted(row["boxes"], "box")]
    if "solvable" in row:
        steps = row["optimal_steps"]
        parts.append("no solution" if steps is None else _counted(steps, "step"))
        parts.append(f"{row['states']:,} states")
    if row.get("lurd"):
        parts.append(_counted(sum(letter.isupper() for letter in row["lurd"]), "push"))
    if row.get("title"):
        parts.append(row["title"])
    return ", ".join(parts)


def _counted(count: int, thing: str) -> str:
    plural = "es" if thing.endswith(("x", "h")) else "s"
    return f"{count} {thing}{'' if count == 1 else plural}"


def tracked(things: Iterable[Any], total: int, what: str) -> Iterator[Any]:
    """Yield the things, with a bar on stderr where that is a terminal."""
    console, quiet = Console(stderr=True), not sys.stderr.isatty()
    yield from track(things, what, total=total, console=console, transient=True, disable=quiet)


def ended(listed: Sequence[Listed], rows: Sequence[Row]) -> int:
    """Return exit code 0; raise CommandError with 2 for levels that cannot be read, 1 for unsolved ones."""
    unread = [one for one in listed if isinstance(one.level, LevelError)]
    if unread:
        message = f"{_named(unread, listed)} cannot be read; the first: {unread[0].level}"
        raise CommandError(message, BAD_USAGE)
    for verdict, reason in _REASONS.items():
        some = [one for one, row in zip(listed, rows, strict=True) if row.get("solvable", True) is verdict]
        if some:
            message = f"{_named(some, listed)} {reason}"
            raise CommandError(message, NOT_SO)
    return OK


def refuse_when_nothing_is_read(listed: Sequence[Listed]) -> None:
    """Raise the first fault when every level has one."""
    faults = [one.level for one in listed if isinstance(one.level, LevelError)]
    if faults and len(faults) == len(listed):
        raise faults[0]


def _named(some: Sequence[Listed], listed: Sequence[Listed]) -> str:
    names = ", ".join(one.name for one in some[:_NAMED_MAX]) + (" ..." if len(some) > _NAMED_MAX else "")
    return names if len(listed) == 1 else f"{len(some)} of {len(listed)} levels ({names})"
