"""Sokoban as a Gymnasium environment, `sfid/Sokoban-v0`: the very rules that sessions are taught by."""

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from services import tiles
from sfid_core.outcome import Outcome
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.board import Board, Level
from sfid_core.sokoban.levels import packaged, packaged_levels, parse_levels
from sfid_core.sokoban.world import World, WorldConfig

GLYPHS = " #.$*@+"
"""What the numbers of an observation stand for, by index, in XSB."""
Cells = npt.NDArray[np.uint8]
_NUMBERS = {glyph: number for number, glyph in enumerate(GLYPHS)}
_EPISODES = 2**31


class SokobanEnvironment(gymnasium.Env[Cells, np.int64]):
    """One level, from one or several starts.

    Actions: 0 LEFT, 1 RIGHT, 2 UP, 3 DOWN; a blocked one leaves the state as it is and is a step.
    Observations: uint8 [height, width], each cell an index of `GLYPHS`. Rewards: `step_reward` for each
    step, `goal_reward` more for the one that solves, `deadlock_reward` more for the one after which the
    level cannot be solved; both end the episode. After `steps_max` steps it is truncated.
    Info: `action_mask` int8 [4], 1 where an action changes something; `optimal_steps`, the fewest steps to
    solved, -1 where there is no way or the level is too large to know; `outcome`, as sessions call it.

    All chance is the start's, drawn by the environment's own generator: `reset(seed=...)` decides it.

    Args: level: a packaged level ("room", "room:0") or XSB text; starts: "1" the level's own, "N" that and
    N - 1 others (the same ones always), "all" that can be solved, "within:K" those at most K steps away.
    Raises: LevelError, WorldError.
    """

    metadata = {"render_modes": ["ansi", "rgb_array"], "render_fps": 8}  # noqa: RUF012 - as Gymnasium has it

    def __init__(
        self,
        *,
        render_mode: str | None = None,
        level: str = "room",
        starts: str = "1",
        goal_reward: float = 10.0,
        step_reward: float = 0.0,
        deadlock_reward: float = -10.0,
        steps_max: int = 200,
    ) -> None:
        rules = WorldConfig(goal_reward, step_reward, deadlock_reward, steps_max)
        self.world = World(_level(level), rules, starts, seed=0)
        self.render_mode = render_mode
        self._board: Board = self.world.level.start
        self._steps = 0
        self._facing = "DOWN"
        shape = self.world.level.height, self.world.level.width
        self.observation_space = gymnasium.spaces.Box(0, len(GLYPHS) - 1, shape, np.uint8)
        self.action_space = gymnasium.spaces.Discrete(len(ACTIONS))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Cells, dict[str, Any]]:
        """Begin an episode at a start that the environment's generator draws."""
        super().reset(seed=seed, options=options)
        self._board = self.world.begin(int(self.np_random.integers(_EPISODES)))
        self._steps, self._facing = 0, "DOWN"
        return self._cells(), self._info(Outcome.RUNNING)

    def step(self, action: np.int64) -> tuple[Cells, float, bool, bool, dict[str, Any]]:
        """Take an action (its index)."""
        taken = ACTIONS[int(action)]
        done = self.world.execute(self._board, taken, self._steps)
        self._board, self._facing = done.board, taken.name
        self._steps += 1
        cut = done.outcome is Outcome.CAP
        return self._cells(), done.reward, done.terminal, cut, self._info(done.outcome)

    def render(self) -> Any:  # noqa: ANN401 - as the render mode says
        """Return XSB text ("ansi") or uint8 pixels [16 height, 16 width, 3] ("rgb_array")."""
        if self.render_mode == "ansi":
            return self._board.to_xsb()
        if self.render_mode == "rgb_array":
            level = self._board.level
            picture = tiles.background(level)
            tiles.draw_boxes(picture, self._board)
            tiles.put(picture, level, self._board.player, tiles.KEEPER[self._facing])
            return tiles.palette()[picture]
        return None

    def optimal_actions(self) -> tuple[int, ...]:
        """Return the indexes of the actions that begin a shortest solution; none where nobody knows."""
        return tuple(int(action) for action in self.world.optimal_actions(self._board))

    def _cells(self) -> Cells:
        rows = self._board.to_xsb().split("\n")
        return np.array([[_NUMBERS[glyph] for glyph in row] for row in rows], np.uint8)

    def _info(self, outcome: Outcome) -> dict[str, Any]:
        board, steps = self._board, self.world.optimal_steps(self._board)
        changes = [self.world.execute(board, action, 0).board is not board for action in ACTIONS]
        return {
            "action_mask": np.array(changes, np.int8),
            "optimal_steps": -1 if steps is None else steps,
            "outcome": outcome.value,
        }


def _level(text: str) -> Level:
    name, _, number = text.partition(":")
    if name in packaged_levels():
        return packaged(name)[int(number or 0)]
    return parse_levels(text)[0]
