"""Where episodes start: the level's own start, or states drawn from those that can be solved."""

import re
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from sfid_core.chance import below, stream
from sfid_core.chance_array import belows
from sfid_core.sokoban.board import Board, Level
from sfid_core.sokoban.solver import Solution

BALANCED_MAX = 65_536
"""Up to this many starts a block of episodes visits each once; the order of more is drawn start by start,
because shuffling a million of them would hold up the first episode for seconds."""

Ids = npt.NDArray[np.int64]

_TEXT = re.compile(r"(all)|within:([1-9][0-9]{0,6})|([1-9][0-9]{0,6})")


class WorldError(ValueError):
    """One line for the person who configured a world: what is wrong, and the mend."""


class StartKind(Enum):
    """A way to choose the states in which episodes start."""

    FIXED = "fixed"
    SAMPLE = "sample"
    ALL = "all"
    WITHIN = "within"


@dataclass(frozen=True, slots=True)
class Starts:
    """A start distribution D.

    Attributes:
        kind: FIXED the level's own start; SAMPLE that and `count` - 1 others, drawn once for all; ALL every
            state that can be solved and is not; WITHIN those of them at most `distance` steps from solved.
        count: states in a SAMPLE, its own start included; at least 1.
        distance: steps; at least 1.

    Raises WorldError.
    """

    kind: StartKind = StartKind.FIXED
    count: int = 1
    distance: int = 1

    def __post_init__(self) -> None:
        if self.count < 1 or self.distance < 1:
            message = f"starts: count {self.count} and distance {self.distance} must be at least 1"
            raise WorldError(message)

    @classmethod
    def parse(cls, text: str) -> "Starts":
        """Read "1" (fixed), "N" (sample of N), "all" or "within:K"."""
        found = _TEXT.fullmatch(text)
        if found is None:
            message = f'starts {text!r} is unknown; use "1", a number of starts, "all" or "within:STEPS"'
            raise WorldError(message)
        if found[1]:
            return cls(StartKind.ALL)
        if found[2]:
            return cls(StartKind.WITHIN, distance=int(found[2]))
        return cls(StartKind.FIXED) if found[3] == "1" else cls(StartKind.SAMPLE, count=int(found[3]))


@dataclass(frozen=True, slots=True)
class StartOrder:
    """Which of `count` starts each episode has.

    Each block of as many episodes as there are starts visits each start once, in an order drawn by the key
    and the block; for ALL, and beyond BALANCED_MAX starts, each episode draws uniformly.
    """

    count: int
    kind: StartKind
    key: int

    @property
    def _drawn_one_by_one(self) -> bool:
        return self.kind is StartKind.ALL or self.count > BALANCED_MAX

    def indexes(self, episodes: int) -> npt.NDArray[np.int64]:
        """Return `index` of the first episodes: int64 [episodes]."""
        if self.count > 1 and self._drawn_one_by_one:
            return belows(stream(self.key, "start"), np.arange(episodes), self.count)
        return np.array([self.index(episode) for episode in range(episodes)], dtype=np.int64)

    def index(self, episode: int) -> int:
        """Return an index in 0..count - 1 for an episode (0 or more)."""
        if self.count == 1:
            return 0
        if self._drawn_one_by_one:
            return below(stream(self.key, "start"), episode, self.count)
        block, place = divmod(episode, self.count)
        return _shuffled(stream(self.key, "start", block), self.count)[place]


class StartDistribution:
    """The starts of a level's episodes, drawn by key alone, in the order of StartOrder.

    Args:
        solution: None for a level with too many states to solve; then only FIXED starts are to be had.
        key: any int of at most 64 bits.

    Raises WorldError when there is no such start.
    """

    def __init__(self, level: Level, solution: Solution | None, spec: Starts, key: int) -> None:
        self._level = level
        self._solution = solution
        self._ids = _ids_of_level(level, solution, spec, key)
        self._order = StartOrder(len(self), spec.kind, key)

    def __len__(self) -> int:
        """Return the number of starts."""
        return 1 if self._ids is None else len(self._ids)

    def board(self, index: int) -> Board:
        """Return one of the starts, index in 0..len - 1; 0 is the level's own for FIXED and SAMPLE."""
        if self._solution is None or self._ids is None:
            return self._level.start
        return self._solution.table.board(int(self._ids[index]))

    def start(self, episode: int) -> Board:
        """Return where an episode (0 or more) starts."""
        return self.board(self._order.index(episode))


def start_ids(pool: Ids, steps: npt.NDArray[np.integer], own: int, spec: Starts, key: int) -> Ids:
    """Return the ids of the starts that a distribution draws.

    Args: pool: ascending ids of the states that can be solved and are not; steps: by id, steps to solved;
    own: the id of the level's own start.  Raises WorldError when there are not so many.
    """
    if spec.kind is StartKind.FIXED:
        return np.array([own], dtype=np.int64)
    if spec.kind is StartKind.WITHIN:
        pool = pool[steps[pool] <= spec.distance]
    if not pool.size:
        message = "the level has no start that can be solved; check its walls, boxes and goals"
        raise WorldError(message)
    if spec.kind in {StartKind.ALL, StartKind.WITHIN}:
        return pool
    if spec.count > len(pool):
        message = f"starts: {spec.count} asked for, but the level has only {len(pool)} that can be solved"
        raise WorldError(message)
    others = pool[pool != own]
    drawn = drawn_among(stream(key, "sample"), len(others), spec.count - 1)
    return np.array([own, *others[drawn]], dtype=np.int64)


def _ids_of_level(level: Level, solution: Solution | None, spec: Starts, key: int) -> Ids | None:
    """Return the ids of the starts, None for the level's own start alone."""
    if spec.kind in {StartKind.FIXED, StartKind.SAMPLE}:
        _check_own_start(level, solution)
    if spec.kind is StartKind.FIXED:
        return None
    if solution is None:
        message = 'the level has too many states to draw starts from; use starts "1", the level\'s own start'
        raise WorldError(message)
    own = solution.table.state_id(level.start)
    return start_ids(solution.solvable_states(), solution.steps, own, spec, key)


def _check_own_start(level: Level, solution: Solution | None) -> None:
    if level.start.solved:
        message = "the level is solved at its start; move a box off its goal"
    elif solution is not None and solution.deadlocked(level.start):
        message = 'the level cannot be solved from its own start; move a box, or use starts "all"'
    else:
        return
    raise WorldError(message)


def drawn_among(key: int, n: int, count: int) -> list[int]:
    """Return `count` different ints below n in drawn order: the first draws of a Fisher-Yates shuffle."""
    moved: dict[int, int] = {}
    drawn = []
    for place in range(count):
        other = place + below(key, place, n - place)
        drawn.append(moved.get(other, other))
        moved[other] = moved.get(place, place)
    return drawn


@lru_cache(maxsize=16)
def _shuffled(key: int, n: int) -> tuple[int, ...]:
    return tuple(drawn_among(key, n, n))
