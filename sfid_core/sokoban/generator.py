"""Levels made to measure: random rooms, judged by the exact solver, the same from the same seed."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb

import numpy as np
import numpy.typing as npt

from sfid_core.chance import below, stream, unit
from sfid_core.sokoban.board import Board, Level
from sfid_core.sokoban.levels import LevelError
from sfid_core.sokoban.solver import Solution, solve
from sfid_core.sokoban.tables import STATES_MAX

SIDE_MIN, SIDE_MAX = 3, 24
BOXES_MAX = 8
ATTEMPTS_MAX = 2_000
"""Rooms drawn for one level before the recipe is called too hard: seconds for a common 8 x 8 room."""

_WALL_SHARE_MIN, _WALL_SHARE_MAX = 0.1, 0.35
"""Walls drawn into a room, as a share of its inner cells: fewer leave a hall, more leave corridors."""
_FLOOR_SHARE_MIN = 0.4
"""The least part of the inner cells that must hang together, so that the room has the size asked for."""
_BLOCKS = ((0,), (0,), (0, 1), (0, 2))
"""What is drawn at a time, as cells: 0 the cell, 1 its right neighbour, 2 the one below."""


class RecipeError(LevelError):
    """One line for the person who ordered levels: what is wrong with the order, and the mend."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """What a generated level must be; RecipeError when no level could.

    Attributes:
        width, height: the grid with its outer walls, SIDE_MIN to SIDE_MAX.
        boxes: 1 to BOXES_MAX.
        steps_min: fewest steps of a shortest solution, at least 1; every box starts off the goals.
        states_max: states of the largest room that is tried, at most STATES_MAX.
    """

    width: int = 8
    height: int = 8
    boxes: int = 2
    steps_min: int = 10
    states_max: int = 1_000_000

    def __post_init__(self) -> None:
        for name, low, high in (
            ("width", SIDE_MIN, SIDE_MAX),
            ("height", SIDE_MIN, SIDE_MAX),
            ("boxes", 1, BOXES_MAX),
            ("steps_min", 1, 100_000),
            ("states_max", 1, STATES_MAX),
        ):
            if not low <= getattr(self, name) <= high:
                message = f"{name} {getattr(self, name)} is outside {low} to {high}: choose another"
                raise RecipeError(message)
        cells = self.cells_min
        if cells > self.inner_cells:
            message = (
                f"{self} has {self.inner_cells} cells inside its walls; boxes, goals and player need "
                f"{cells}: enlarge it or take fewer boxes"
            )
            raise RecipeError(message)
        states = cells * comb(cells, self.boxes)
        if states > self.states_max:
            message = (
                f"{self} has at least {states:,} states, more than {self.states_max:,}; "
                "take fewer boxes or a smaller room"
            )
            raise RecipeError(message)

    def __str__(self) -> str:
        """Return the room in words."""
        return f"a room of {self.width} x {self.height} with {_counted_boxes(self.boxes)}"

    @property
    def inner_cells(self) -> int:
        """Return the number of cells inside the outer walls."""
        return (self.width - 2) * (self.height - 2)

    @property
    def cells_min(self) -> int:
        """Return the least floor of a room: room for the things on it, and the share of the whole."""
        return max(2 * self.boxes + 1, round(_FLOOR_SHARE_MIN * self.inner_cells))


def generate(recipe: Recipe, seed: int) -> Iterator[Level]:
    """Yield levels without end, all different, each solvable in `steps_min` steps or more, as its title says.

    Args: seed: any int of at most 64 bits; the n-th level depends on recipe, seed and n alone.
    Raises RecipeError when ATTEMPTS_MAX rooms in a row gave no level.
    """
    made: set[bytes] = set()
    attempt = last = 0
    while attempt < last + ATTEMPTS_MAX:
        level = _level(recipe, _Draws(stream(seed, "level", attempt)))
        attempt += 1
        if level is None or level.digest in made:
            continue
        made.add(level.digest)
        last = attempt
        yield level
    message = (
        f"{recipe} that needs {recipe.steps_min} steps or more: none in {ATTEMPTS_MAX:,} rooms after the "
        f"first {len(made)}; ask for fewer steps or a larger room"
    )
    raise RecipeError(message)


@dataclass(slots=True)
class _Draws:
    """The draws of one attempt, one after the other."""

    key: int
    counter: int = 0

    def below(self, n: int) -> int:
        self.counter += 1
        return below(self.key, self.counter - 1, n)

    def between(self, low: float, high: float) -> float:
        self.counter += 1
        return low + (high - low) * unit(self.key, self.counter - 1)

    def some(self, cells: list[int], count: int) -> list[int]:
        """Take `count` different cells out of a list."""
        rest = list(cells)
        return [rest.pop(self.below(len(rest))) for _ in range(count)]


def _level(recipe: Recipe, draws: _Draws) -> Level | None:
    """Return a level for the recipe in one drawn room, or None when the room has none."""
    floor = _floor(recipe, draws)
    if len(floor) < recipe.cells_min or len(floor) * comb(len(floor), recipe.boxes) > recipe.states_max:
        return None
    *goals, player = draws.some(floor, recipe.boxes + 1)
    walls = frozenset(range(recipe.width * recipe.height)) - frozenset(floor)
    room = Level(recipe.width, recipe.height, walls, tuple(goals), player, tuple(goals))
    solution = solve(room)
    start = _start(solution, recipe.steps_min, draws)
    if start is None:
        return None
    title = f"{_counted_boxes(recipe.boxes)}, {solution.distance(start)} steps"
    return Level(recipe.width, recipe.height, walls, tuple(goals), start.player, start.boxes, title)


def _floor(recipe: Recipe, draws: _Draws) -> list[int]:
    """Return, ascending, the largest connected part of a room after walls were drawn into it."""
    width, inner = recipe.width, _inner_cells(recipe)
    free = set(inner)
    wanted = round(draws.between(_WALL_SHARE_MIN, _WALL_SHARE_MAX) * len(inner))
    while len(inner) - len(free) < wanted:
        cell = inner[draws.below(len(inner))]
        shape = _BLOCKS[draws.below(len(_BLOCKS))]
        free -= {cell + (0, 1, width)[part] for part in shape}
    parts: list[list[int]] = []
    while free:
        parts.append(_connected(min(free), free, width))
        free -= set(parts[-1])
    return max(parts, key=len, default=[])


def _inner_cells(recipe: Recipe) -> list[int]:
    rows, columns = range(1, recipe.height - 1), range(1, recipe.width - 1)
    return [row * recipe.width + column for row in rows for column in columns]


def _connected(first: int, free: set[int], width: int) -> list[int]:
    seen, open_cells = {first}, [first]
    while open_cells:
        cell = open_cells.pop()
        fresh = ({cell - 1, cell + 1, cell - width, cell + width} & free) - seen
        seen |= fresh
        open_cells.extend(fresh)
    return sorted(seen)


def _start(solution: Solution, steps_min: int, draws: _Draws) -> Board | None:
    """Return one of the states that are far enough from solved and have every box off the goals."""
    far = np.flatnonzero(solution.steps >= steps_min)
    table = solution.table
    goals: npt.NDArray[np.bool_] = np.isin(table.cells, np.array(table.level.goals))
    on_goal: npt.NDArray[np.bool_] = np.logical_or.reduce(goals[table.boxes])
    far = far[~on_goal[far // table.n_cells]]
    return table.board(int(far[draws.below(len(far))])) if len(far) else None


def _counted_boxes(count: int) -> str:
    return "one box" if count == 1 else f"{count} boxes"
