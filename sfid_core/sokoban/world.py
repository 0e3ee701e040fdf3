"""The rules of an episode: where it starts, what an action brings, when it ends."""

from dataclasses import dataclass
from functools import cached_property
from math import isfinite

from sfid_core.chance import stream
from sfid_core.outcome import Outcome
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.board import Board, Level
from sfid_core.sokoban.deadlock import surely_deadlocked
from sfid_core.sokoban.levels import parse_levels
from sfid_core.sokoban.rules import step
from sfid_core.sokoban.solver import Solution, solve
from sfid_core.sokoban.starts import StartDistribution, Starts, WorldError
from sfid_core.sokoban.tables import STATES_MAX, TooManyStates

__all__ = ["Consequence", "World", "WorldConfig", "WorldError", "make_world"]


@dataclass(frozen=True, slots=True)
class WorldConfig:
    """Rewards and bounds of an episode; WorldError when one makes no sense.

    Attributes:
        goal_reward: added to the step that solves the level.
        step_reward: paid for every step, blocked ones included.
        deadlock_reward: added to the step after which the level cannot be solved any more; that ends the
            episode. Keep it at or below step_reward / (1 - gamma), or dying early pays.
        steps_max: cap of an episode in steps; a capped episode is cut off, not terminal.
        states_max: states of the largest level that is solved exactly.
    """

    goal_reward: float = 10.0
    step_reward: float = 0.0
    deadlock_reward: float = -10.0
    steps_max: int = 200
    states_max: int = STATES_MAX

    def __post_init__(self) -> None:
        for name in ("goal_reward", "step_reward", "deadlock_reward"):
            if not isfinite(getattr(self, name)):
                message = f"{name} is {getattr(self, name)}; give a finite number"
                raise WorldError(message)
        for name in ("steps_max", "states_max"):
            if getattr(self, name) < 1:
                message = f"{name} is {getattr(self, name)}; give at least 1"
                raise WorldError(message)


@dataclass(frozen=True, slots=True)
class Consequence:
    """What one action brought.

    Attributes:
        terminal: True when nothing can follow (SOLVED, DEADLOCK). False at the CAP too: the episode is cut
            off there, and a learner still looks ahead to the value of `board`.
    """

    board: Board
    reward: float
    outcome: Outcome

    @property
    def terminal(self) -> bool:
        """Tell whether the state is absorbing, so that no value lies beyond it."""
        return self.outcome.terminal


class World:
    """One level under one configuration; all methods are functions of their arguments.

    Args:
        starts: a Starts, or its text: "1", "N", "all", "within:K".
        seed: any int of at most 64 bits; decides the drawn starts and their order.
        solution: the exact distances of this level, where another world has them already.

    Building one is cheap; the level is solved when that is first needed.
    """

    def __init__(
        self,
        level: Level,
        config: WorldConfig,
        starts: Starts | str,
        seed: int,
        solution: Solution | None = None,
    ) -> None:
        self.level = level
        self.config = config
        self.starts = Starts.parse(starts) if isinstance(starts, str) else starts
        self.seed = seed
        if solution is not None:
            self.__dict__["solution"] = solution  # what the cached property would compute

    @cached_property
    def solution(self) -> Solution | None:
        """Return the exact distances, or None when the level has too many states."""
        try:
            return solve(self.level, self.config.states_max)
        except TooManyStates:
            return None

    @cached_property
    def distribution(self) -> StartDistribution:
        """Return the starts; WorldError when the level cannot give them."""
        return StartDistribution(self.level, self.solution, self.starts, stream(self.seed, "starts"))

    def begin(self, episode: int) -> Board:
        """Return where an episode (0 or more) starts; WorldError when the level cannot give such starts."""
        return self.distribution.start(episode)

    def optimal_steps(self, board: Board) -> int | None:
        """Return the fewest steps to solved; None when there is no way or the level is not solved exactly."""
        return None if self.solution is None else self.solution.distance(board)

    def optimal_actions(self, board: Board) -> tuple[Action, ...]:
        """Return the actions that begin a shortest solution; none where `optimal_steps` is 0 or None."""
        return () if self.solution is None else self.solution.optimal_actions(board)

    def deadlocked(self, board: Board) -> bool:
        """Tell whether the board cannot be solved: exactly, or provably for a level too large to solve."""
        return surely_deadlocked(board) if self.solution is None else self.solution.deadlocked(board)

    def execute(self, board: Board, action: Action, steps_done: int) -> Consequence:
        """Return what an action brings in an episode of `steps_done` (0 or more) steps so far."""
        after = step(board, action).board
        config = self.config
        if after.solved:
            return Consequence(after, config.step_reward + config.goal_reward, Outcome.SOLVED)
        if after is not board and self.deadlocked(after):
            return Consequence(after, config.step_reward + config.deadlock_reward, Outcome.DEADLOCK)
        capped = steps_done + 1 >= config.steps_max
        return Consequence(after, config.step_reward, Outcome.CAP if capped else Outcome.RUNNING)


def make_world(level: str, config: WorldConfig, starts: Starts | str, seed: int) -> World:
    """Return the world of the first level in a text; raises LevelError or WorldError."""
    return World(parse_levels(level)[0], config, starts, seed)
