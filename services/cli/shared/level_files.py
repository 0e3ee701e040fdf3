"""How levels are named on the command line, and read from there."""

import re
from dataclasses import dataclass
from pathlib import Path

from services.cli.shared.failure import CommandError
from sfid_core.sokoban.board import Level
from sfid_core.sokoban.levels import LevelError, packaged, packaged_levels, read_bytes
from sfid_core.sokoban.world import World, WorldConfig, WorldError

_NUMBERED = re.compile(r"(.*):([0-9]{1,9})", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Listed:
    """One level of a file or packaged set, or the fault for which it cannot be read."""

    index: int
    level: Level | LevelError
    where: str

    @property
    def name(self) -> str:
        """Return what the command line calls it."""
        return f"{self.where}:{self.index}"


def find_level(text: str) -> tuple[str, Level]:
    """Return (title or file and number, level) for "NAME[:N]" or "FILE[:N]", N from 0, the first without N.

    Raises: CommandError or LevelError, one line with the mend.
    """
    found = find_levels(text)[0]
    if isinstance(found.level, LevelError):
        raise found.level
    return found.level.title or f"{Path(found.where).name}:{found.index}", found.level


def check_starts(name: str, level: Level, starts: str, seed: int) -> None:
    """Refuse a level that cannot give such starts, before anything is started for it.

    Raises: WorldError, one line with the mend.
    """
    try:
        World(level, WorldConfig(), starts, seed).begin(0)
    except WorldError as error:
        message = f"level {name!r}: {error}"
        raise WorldError(message) from None


def find_levels(text: str) -> tuple[Listed, ...]:
    """Return the level "NAME:N" of a packaged set or "FILE:N", or all levels of "NAME" or "FILE".

    Raises: CommandError or LevelError, one line with the mend; a fault of one level is that level's.
    """
    found = _NUMBERED.fullmatch(text)
    where = found[1] if found else text
    read = packaged(where) if where in packaged_levels() else read_bytes(_bytes_of(where), where)
    listed = tuple(Listed(index, level, where) for index, level in enumerate(read))
    if not found:
        return listed
    if int(found[2]) >= len(listed):
        count = "one level" if len(listed) == 1 else f"{len(listed)} levels"
        choice = listed[0].name if len(listed) == 1 else f"one from {listed[0].name} to {listed[-1].name}"
        message = f"{where} has {count}, counted from 0: name {choice}"
        raise CommandError(message)
    return (listed[int(found[2])],)


def _bytes_of(where: str) -> bytes:
    try:
        return Path(where).read_bytes()
    except (OSError, ValueError) as error:
        set_or_file, _, number = where.rpartition(":")
        if set_or_file in packaged_levels() or (set_or_file and Path(set_or_file).is_file()):
            said = f"{where[:80]!r}: {number[:40]!r} is no level's number"
            raise CommandError(f"{said}: they count from 0, as in {set_or_file}:0") from None
        names = ", ".join(packaged_levels())
        reason = getattr(error, "strerror", None) or error
        message = f"no level {where!r}: {reason}: name a packaged set ({names}) or a file in XSB"
        raise CommandError(message) from None
