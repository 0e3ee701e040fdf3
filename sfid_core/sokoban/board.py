"""A level (what never changes, and the start) and a board (one position in it)."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2b
from itertools import product
from struct import pack
from typing import NamedTuple

from sfid_core.sokoban.actions import DELTAS

KEY_BYTES = 16
BLOCKED = -1
"""In neighbour tables: a wall, or the edge of the grid."""

_GLYPHS = {
    # (is goal, holds a box, holds the player): glyph of the XSB format
    (False, False, False): " ",
    (True, False, False): ".",
    (False, True, False): "$",
    (True, True, False): "*",
    (False, False, True): "@",
    (True, False, True): "+",
}


def _cells_as_bytes(cells: Sequence[int]) -> bytes:
    return pack(f"<{len(cells)}I", *cells)


@dataclass(frozen=True)
class Level:
    """A level: its walls, goals and start.

    A cell is row * width + column, rows counted from the top; walls, goals and boxes are kept in
    ascending order. `sfid_core.sokoban.levels` makes levels out of text and names what is wrong with
    them; built by hand, a level must hold its cells inside the grid and off the walls (ValueError).
    """

    width: int
    height: int
    walls: frozenset[int]
    goals: tuple[int, ...]
    player: int
    boxes: tuple[int, ...]
    title: str = ""
    author: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "goals", tuple(sorted(self.goals)))
        object.__setattr__(self, "boxes", tuple(sorted(self.boxes)))
        cells = (*self.walls, *self.goals, *self.boxes, self.player)
        if not all(0 <= cell < self.width * self.height for cell in cells):
            message = f"a cell of the level lies outside its {self.width} x {self.height} grid"
            raise ValueError(message)
        if not self.walls.isdisjoint((*self.goals, *self.boxes, self.player)):
            message = "a goal, box or player of the level stands in a wall"
            raise ValueError(message)
        if len(set(self.boxes)) != len(self.boxes) or self.player in self.boxes:
            message = "two boxes, or a box and the player, share a cell of the level"
            raise ValueError(message)

    @property
    def start(self) -> "Board":
        """Return the position the level's file shows."""
        return Board(self, self.player, self.boxes)

    @cached_property
    def digest(self) -> bytes:
        """Return the 16 bytes that name this level: size, walls, goals and start, not its title."""
        hasher = blake2b(self.map_digest, digest_size=KEY_BYTES, person=b"sfid-level")
        hasher.update(_cells_as_bytes((self.player, *self.boxes)))
        return hasher.digest()

    @cached_property
    def map_digest(self) -> bytes:
        """Return the 16 bytes that name size, walls and goals, whatever the start."""
        parts = ((self.width, self.height), tuple(sorted(self.walls)), self.goals)
        hasher = blake2b(digest_size=KEY_BYTES, person=b"sfid-map")
        for part in parts:
            hasher.update(_cells_as_bytes((len(part), *part)))
        return hasher.digest()

    @cached_property
    def goal_set(self) -> frozenset[int]:
        """Return the goals for membership tests."""
        return frozenset(self.goals)

    @cached_property
    def neighbours(self) -> tuple[tuple[int, ...], ...]:
        """Return neighbours[action][cell]: the cell one step on, or BLOCKED."""
        return tuple(
            tuple(self._towards(row, column, delta) for row, column in self._grid()) for delta in DELTAS
        )

    @cached_property
    def reach(self) -> tuple[int, ...]:
        """Return, ascending, every cell the player could stand on if boxes were no obstacle."""
        seen = {self.player}
        open_cells = [self.player]
        while open_cells:
            cell = open_cells.pop()
            fresh = {table[cell] for table in self.neighbours} - seen - {BLOCKED}
            seen |= fresh
            open_cells.extend(fresh)
        return tuple(sorted(seen))

    def state_keys(self, placements: Iterable[Sequence[int]]) -> Iterator[bytes]:
        """Yield `Board.state_key` of each position, given as its player and then its ascending boxes."""
        named = blake2b(self.map_digest, digest_size=KEY_BYTES, person=b"sfid-state")
        for cells in placements:
            hasher = named.copy()
            hasher.update(_cells_as_bytes(cells))
            yield hasher.digest()

    def to_xsb(self) -> str:
        """Return the level as XSB text that parses back to it; a blank row holds one `-`."""
        return "\n".join(row if row.strip() else "-" + row[1:] for row in self.start.to_xsb().split("\n"))

    def _grid(self) -> "product[tuple[int, int]]":
        return product(range(self.height), range(self.width))

    def _towards(self, row: int, column: int, delta: tuple[int, int]) -> int:
        row, column = row + delta[0], column + delta[1]
        inside = 0 <= row < self.height and 0 <= column < self.width
        cell = row * self.width + column
        return cell if inside and cell not in self.walls else BLOCKED


class Board(NamedTuple):
    """One position: where the player and the boxes (ascending cells) are on a level.

    A named tuple because every step makes one, and a frozen dataclass takes three times as long to make.
    """

    level: Level
    player: int
    boxes: tuple[int, ...]

    @property
    def solved(self) -> bool:
        """Tell whether every box stands on a goal."""
        return self.level.goal_set.issuperset(self.boxes)

    def state_key(self) -> bytes:
        """Return the 16 bytes that name this position on this map, the same from every start."""
        hasher = blake2b(self.level.map_digest, digest_size=KEY_BYTES, person=b"sfid-state")
        hasher.update(_cells_as_bytes((self.player, *self.boxes)))
        return hasher.digest()

    def with_state(self, player: int, boxes: tuple[int, ...]) -> "Board":
        """Return the same level with the player and the boxes elsewhere (any order of boxes)."""
        return Board(self.level, player, tuple(sorted(boxes)))

    def to_xsb(self) -> str:
        """Return the whole grid as XSB rows of equal length joined by newlines, floor as space."""
        level = self.level
        boxes = set(self.boxes)
        cells = [
            "#"
            if cell in level.walls
            else _GLYPHS[(cell in level.goal_set, cell in boxes, cell == self.player)]
            for cell in range(level.width * level.height)
        ]
        return "\n".join(
            "".join(cells[first : first + level.width]) for first in range(0, len(cells), level.width)
        )
