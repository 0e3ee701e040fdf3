"""The optimal actions of a view, where the exact solver reaches: solved aside, nobody waits for it."""

import logging
import threading
from collections.abc import Callable
from functools import lru_cache

from sfid_core.sokoban.board import Level
from sfid_core.sokoban.levels import LevelError, parse_levels
from sfid_core.sokoban.solver import Solution, solve
from sfid_core.sokoban.tables import TooManyStates

log = logging.getLogger("sfid.aggregator")

VIEWS_KEPT = 65_536
LEVELS_KEPT = 256


def in_a_thread(work: Callable[[], None]) -> None:
    """Do the work on a thread of its own."""
    threading.Thread(target=work, name="solver", daemon=True).start()


class Optima:
    """Knows nothing of a level until it is solved; of what is no Sokoban, or too large, for ever.

    Args: start: does the solving; `in_a_thread` where the caller must not wait.
    """

    def __init__(self, start: Callable[[Callable[[], None]], None] = in_a_thread) -> None:
        self._start = start
        self._solutions: dict[tuple[bytes, int], Solution | None] = {}
        self._solving: set[tuple[bytes, int]] = set()
        self._known = lru_cache(VIEWS_KEPT)(self._look)

    def names(self, view: str) -> tuple[str, ...]:
        """Return the names of the view's optimal actions, none where they are not known (yet)."""
        try:
            return self._known(view)
        except _NotYet:
            return ()

    def _look(self, view: str) -> tuple[str, ...]:
        try:
            board = parse_levels(view)[0].start
        except LevelError:
            return ()
        level = board.level
        key = level.map_digest, len(level.boxes)
        if key not in self._solutions and key not in self._solving:
            if len(self._solutions) + len(self._solving) >= LEVELS_KEPT:
                return ()
            self._solving.add(key)
            self._start(lambda: self._solve(key, level))
        if key not in self._solutions:
            raise _NotYet
        solution = self._solutions[key]
        return () if solution is None else tuple(action.name for action in solution.optimal_actions(board))

    def _solve(self, key: tuple[bytes, int], level: Level) -> None:
        solution: Solution | None = None
        try:
            solution = solve(level)
        except TooManyStates as error:
            log.info("the optimal actions of a level stay unknown: %s", error)
        self._solutions[key] = solution
        self._solving.discard(key)


class _NotYet(Exception):  # noqa: N818 - not a fault; keeps the answer out of the cache
    """The level is not solved."""
