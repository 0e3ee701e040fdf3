"""Figure 2 as one loop with Gymnasium, a defaultdict and NumPy: as a researcher writes it, and tuned by hand.

`RoomEnv` keeps to the guide "Make your own custom environment" of Gymnasium's documentation: positions are
arrays, actions are looked up as directions, `_get_obs` makes the observation (here the grid), arrays are
compared with `np.array_equal`; it is registered and made with the wrappers that `gymnasium.make` puts around
it. The agent is the usual one: `defaultdict(lambda: np.zeros(4))` by the observation's bytes, ties broken by
`rng.choice`. What costs thought is done beforehand in both: the solver's distances, the optimal actions.

`TupleRoomEnv` is what a profiler leads to: the state is a tuple of ints, the observation an array of four
numbers. It stands beside the other so that a reader sees how much of a ratio is the loop's own style. Both
run the same experiment: from the same generator they have the same measures.
"""

from collections import defaultdict, deque
from typing import Any, SupportsFloat

import gymnasium
import numpy as np
import numpy.typing as npt

EPISODES, STEPS_MAX, GAMMA, ALPHA = 30, 200, 0.9, 0.1
MOVES = ((0, -1), (0, 1), (-1, 0), (1, 0))
EMPTY, WALL, GOAL, BOX, PLAYER = range(5)
TEACHERS = ((0.02, 0.02, 0.02), (0.1, 0.35, 0.1))
"""Of the expert and the naive teacher: wrong labels, wrong judgements, silence."""
State = tuple[int, int, int, int]
"""Row and column of the player, then of the box."""
Observation = npt.NDArray[Any]
Stepped = tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]


class Room:
    """What is known of the packaged room before anybody learns: its walls, its goal, every distance."""

    def __init__(self, xsb: str) -> None:
        symbols = np.array([list(row) for row in xsb.splitlines()])
        self.walls = symbols == "#"
        self.goal: tuple[int, int] = tuple(np.argwhere(symbols == ".")[0].tolist())
        self.distance = self._distances()
        self.starts = [state for state, steps in self.distance.items() if steps > 0]

    def after(self, state: State, action: int) -> State:
        """Return where an action leads."""
        row, col, box_row, box_col = state
        d_row, d_col = MOVES[action]
        row, col = row + d_row, col + d_col
        if self.walls[row, col]:
            return state
        if (row, col) == (box_row, box_col):
            box_row, box_col = box_row + d_row, box_col + d_col
            if self.walls[box_row, box_col]:
                return state
        return row, col, box_row, box_col

    def _distances(self) -> dict[State, int]:
        """Return the fewest steps to the goal of every state that can be solved."""
        floor = [tuple(cell) for cell in np.argwhere(~self.walls).tolist()]
        states: list[State] = [(*player, *box) for player in floor for box in floor if player != box]  # type: ignore[misc]
        before: dict[State, list[State]] = defaultdict(list)
        for state in states:
            if state[2:] != self.goal:
                for action in range(4):
                    before[self.after(state, action)].append(state)
        distance = {state: 0 for state in states if state[2:] == self.goal}
        queue = deque(distance)
        while queue:
            state = queue.popleft()
            for earlier in before[state]:
                if earlier not in distance:
                    distance[earlier] = distance[state] + 1
                    queue.append(earlier)
        return distance

    def optimal(self, state: State) -> list[int]:
        """Return the actions that begin a shortest solution."""
        nearer = self.distance[state] - 1
        return [action for action in range(4) if self.distance.get(self.after(state, action)) == nearer]


class RoomEnv(gymnasium.Env[Any, Any]):
    """The room as Gymnasium's guide writes an environment: arrays, and the grid as observation."""

    def __init__(self, room: Room) -> None:
        self.action_space: gymnasium.Space[Any] = gymnasium.spaces.Discrete(4)
        self.observation_space: gymnasium.Space[Any] = gymnasium.spaces.Box(
            EMPTY, PLAYER, room.walls.shape, np.uint8
        )
        self._action_to_direction = {action: np.array(move) for action, move in enumerate(MOVES)}
        self._starts = room.starts
        self._grid = np.where(room.walls, WALL, EMPTY).astype(np.uint8)
        self._grid[room.goal] = GOAL
        self._goal_location = np.array(room.goal)
        # With one box in an open room it is the box's place alone that decides whether all is lost.
        self._lost = np.ones(room.walls.shape, dtype=bool)
        for *_, box_row, box_col in room.distance:
            self._lost[box_row, box_col] = False

    def _get_obs(self) -> Observation:
        grid = self._grid.copy()
        grid[tuple(self._box_location)] = BOX
        grid[tuple(self._player_location)] = PLAYER
        return grid

    def observed(self, state: State) -> bytes:
        """Return the bytes of a state's observation."""
        self._player_location, self._box_location = np.array(state[:2]), np.array(state[2:])
        return self._get_obs().tobytes()

    @staticmethod
    def key(seen: Observation) -> bytes:
        """Return what stands for an observation in a dictionary."""
        return seen.tobytes()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin at the start that the options name."""
        super().reset(seed=seed)
        start = self._starts[(options or {"start": 0})["start"]]
        self._player_location, self._box_location = np.array(start[:2]), np.array(start[2:])
        return self._get_obs(), {}

    def step(self, action: int) -> Stepped:
        """Move; solved and deadlocked states end the episode."""
        direction = self._action_to_direction[action]
        ahead = self._player_location + direction
        if np.array_equal(ahead, self._box_location):
            beyond = ahead + direction
            if self._grid[tuple(beyond)] != WALL:
                self._player_location, self._box_location = ahead, beyond
        elif self._grid[tuple(ahead)] != WALL:
            self._player_location = ahead
        solved = np.array_equal(self._box_location, self._goal_location)
        lost = bool(self._lost[tuple(self._box_location)])
        reward = 10.0 if solved else -10.0 if lost else 0.0
        return self._get_obs(), reward, solved or lost, False, {}


class TupleRoomEnv(gymnasium.Env[Any, Any]):
    """The same room tuned by hand: the state is a tuple of ints and its array is the observation."""

    def __init__(self, room: Room) -> None:
        self._room = room
        sizes = [*room.walls.shape, *room.walls.shape]
        self.action_space: gymnasium.Space[Any] = gymnasium.spaces.Discrete(4)
        self.observation_space: gymnasium.Space[Any] = gymnasium.spaces.MultiDiscrete(sizes)
        self._state: State = room.starts[0]

    @staticmethod
    def observed(state: State) -> State:
        """Return what stands for a state in a dictionary."""
        return state

    @staticmethod
    def key(seen: Observation) -> Any:  # noqa: ANN401 - a State
        """Return what stands for an observation in a dictionary."""
        return tuple(seen.tolist())

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin at the start that the options name."""
        super().reset(seed=seed)
        self._state = self._room.starts[(options or {"start": 0})["start"]]
        return np.array(self._state), {}

    def step(self, action: int) -> Stepped:
        """Move; solved and deadlocked states end the episode."""
        self._state = self._room.after(self._state, action)
        seen = np.array(self._state)
        if self._state[2:] == self._room.goal:
            return seen, 10.0, True, False, {}
        if self._state not in self._room.distance:
            return seen, -10.0, True, False, {}
        return seen, 0.0, False, False, {}


class Researcher:
    """The whole experiment as one loop over an environment made by `gymnasium.make`."""

    def __init__(self, room: Room, env: type[RoomEnv] | type[TupleRoomEnv] = RoomEnv) -> None:
        name = f"{env.__name__}-v0"
        if name not in gymnasium.registry:
            gymnasium.register(name, lambda **_: env(room), max_episode_steps=STEPS_MAX)
        self.env = gymnasium.make(name)
        plain = env(room)
        self._key = plain.key
        self._optimal: dict[Any, list[int]] = {
            plain.observed(state): room.optimal(state) for state in room.starts
        }
        self._n_starts = len(room.starts)

    def run(self, seeds: int) -> int:
        """Run the four conditions; return the steps taken."""
        return int(sum(self.measures(seed)[:, :, 1].sum() for seed in range(seeds)))

    def measures(self, seed: int) -> npt.NDArray[np.float64]:
        """Return the four measures of one subject: float64 [conditions, episodes, 4]."""
        return np.array([
            self.session(
                np.random.default_rng(seed), label_error if labels else reward_error, silence, labels=labels
            )
            for label_error, reward_error, silence in TEACHERS
            for labels in (True, False)
        ])  # fmt: skip

    def session(
        self, rng: np.random.Generator, error: float, silence: float, *, labels: bool
    ) -> npt.NDArray[np.float64]:
        """Teach one subject for thirty episodes; return the four measures of each."""
        q: defaultdict[Any, npt.NDArray[np.float64]] = defaultdict(lambda: np.zeros(4))
        preferred: dict[Any, int] = {}
        starts = rng.choice(self._n_starts, 4, replace=False)
        measures = np.zeros((EPISODES, 4))
        for episode in range(EPISODES):
            seen, _ = self.env.reset(options={"start": int(starts[episode % 4])})
            state = self._key(seen)
            done, discount, n_steps, inputs, errors, total = False, 1.0, 0, 0, 0.0, 0.0
            while not done:
                row = q[state]
                action = int(rng.choice(np.flatnonzero(row == row.max())))
                if state not in preferred:
                    preferred[state] = int(rng.choice(self._optimal[state]))
                h = 0.0
                if rng.random() >= silence:
                    inputs += 1
                    right = action == preferred[state]
                    if rng.random() < error:
                        wrong = [other for other in range(4) if other != preferred[state]]
                        right = action == wrong[rng.integers(3)] if labels else not right
                    h = 1.0 if right else -1.0
                seen, reward, terminated, truncated, _ = self.env.step(action)
                after = self._key(seen)
                ahead = 0.0 if terminated else q[after].max()
                delta = float(reward) + GAMMA * ahead - row[action]
                row[action] += ALPHA * (delta + h)
                errors += abs(delta)
                total += discount * (float(reward) + h)
                discount *= GAMMA
                n_steps += 1
                state, done = after, terminated or truncated
            measures[episode] = errors / n_steps, n_steps, total, inputs
        return measures
