"""The founding paper's experiment beside a researcher's loop: Gymnasium, a defaultdict and NumPy.

    python tests/benchmarks/experiment.py [--json] [--seeds N] [--rounds N] [--researcher-seeds N]

Both run all of figure 2: four conditions, 30 episodes, the room with one box, step cap 200, the four measures
of every episode. One round runs the researcher's loop over a few seeds, ours compiled over all of them and
ours without a compiler over some; a ratio is the median over rounds of their seconds a step divided by ours,
so that a busy machine slows all. Compilation is told apart: machine code is kept between runs.
"""

import argparse
import json
import os
import tempfile
from collections import defaultdict, deque
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, SupportsFloat

import gymnasium
import numpy as np
import numpy.typing as npt

from services.experiments.runner import RunnerConfig, run_conditions
from services.runtime.sources import keep_machine_code
from sfid_core.experiments import figure2
from sfid_core.experiments.condition import column
from sfid_core.session.config import WorldSpec
from sfid_core.sokoban.levels import packaged

FLOOR_STEPS_S = 15_000
"""Steps a second that the researcher's loop must reach, or it is no fair baseline."""
BARS = {"compiled": 1_000.0, "without a compiler": 10.0}
MOVES = ((0, -1), (0, 1), (-1, 0), (1, 0))
GAMMA, ALPHA, EPISODES = 0.9, 0.1, figure2.EPISODES
State = tuple[int, int, int, int]
"""Row and column of the player, then of the box."""
Observation = npt.NDArray[np.int64]
"""The same as an array, as Gymnasium's environments return it."""


class RoomEnv(gymnasium.Env[Any, Any]):
    """The packaged room as a researcher writes it: a grid of walls, a player, a box and a goal."""

    def __init__(self, xsb: str) -> None:
        grid = [list(row) for row in xsb.splitlines()]
        self.walls = np.array([[cell == "#" for cell in row] for row in grid])
        self.goal = next((r, c) for r, row in enumerate(grid) for c, cell in enumerate(row) if cell == ".")
        sizes = [*self.walls.shape, *self.walls.shape]
        self.action_space: gymnasium.Space[Any] = gymnasium.spaces.Discrete(4)
        self.observation_space: gymnasium.Space[Any] = gymnasium.spaces.MultiDiscrete(sizes)
        self.distance = self._distances()
        self.starts = [state for state, steps in self.distance.items() if steps > 0]
        self.state: State = self.starts[0]

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

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin at the start that the options name."""
        super().reset(seed=seed)
        self.state = self.starts[(options or {"start": 0})["start"]]
        return np.array(self.state), {}

    def step(self, action: int) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Move; solved and deadlocked states end the episode."""
        self.state = self.after(self.state, action)
        seen = np.array(self.state)
        if self.state[2:] == self.goal:
            return seen, 10.0, True, False, {}
        if self.state not in self.distance:
            return seen, -10.0, True, False, {}
        return seen, 0.0, False, False, {}


class Researcher:
    """The whole experiment as one loop."""

    def __init__(self, xsb: str) -> None:
        room = RoomEnv(xsb)
        gymnasium.register("Room-v0", lambda **_: RoomEnv(xsb), max_episode_steps=200)
        self.env = gymnasium.make("Room-v0")
        self.optimal = {state: room.optimal(state) for state in room.starts}
        self.n_starts = len(room.starts)

    def run(self, seeds: int) -> int:
        """Run the four conditions; return the steps taken."""
        steps = 0
        for label_error, reward_error, silence in ((0.02, 0.02, 0.02), (0.1, 0.35, 0.1)):
            for labels in (True, False):
                for seed in range(seeds):
                    rng = np.random.default_rng(seed)
                    error = label_error if labels else reward_error
                    steps += int(self.session(rng, error, silence, labels=labels)[:, 1].sum())
        return steps

    def session(
        self, rng: np.random.Generator, error: float, silence: float, *, labels: bool
    ) -> npt.NDArray[np.float64]:
        """Teach one subject for thirty episodes; return the four measures of each."""
        q: defaultdict[State, npt.NDArray[np.float64]] = defaultdict(lambda: np.zeros(4))
        preferred: dict[State, int] = {}
        starts = rng.choice(self.n_starts, 4, replace=False)
        measures = np.zeros((EPISODES, 4))
        for episode in range(EPISODES):
            seen, _ = self.env.reset(options={"start": int(starts[episode % 4])})
            state = tuple(seen.tolist())
            done, discount, n_steps, inputs, errors, total = False, 1.0, 0, 0, 0.0, 0.0
            while not done:
                row = q[state]
                action = int(rng.choice(np.flatnonzero(row == row.max())))
                if state not in preferred:
                    preferred[state] = int(rng.choice(self.optimal[state]))
                h = 0.0
                if rng.random() >= silence:
                    inputs += 1
                    right = action == preferred[state]
                    if rng.random() < error:
                        wrong = [other for other in range(4) if other != preferred[state]]
                        right = action == wrong[rng.integers(3)] if labels else not right
                    h = 1.0 if right else -1.0
                seen, reward, terminated, truncated, _ = self.env.step(action)
                after = tuple(seen.tolist())
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


def our_steps(xsb: str, seeds: int, *, fast: bool) -> tuple[float, int]:
    """Run our experiment with all cores; return (seconds, steps)."""
    conditions = figure2.conditions(WorldSpec(xsb, "room"))
    began = perf_counter()
    results = run_conditions(conditions, range(seeds), RunnerConfig(fast=fast), lambda _done, _of: None)
    seconds = perf_counter() - began
    return seconds, int(sum(column(one, "steps").sum() for one in results))


def measure(rounds: int, seeds: int, researcher_seeds: int) -> dict[str, object]:
    """Run all rounds and return the report."""
    xsb = packaged("room")[0].to_xsb()
    researcher = Researcher(xsb)
    kept = tempfile.mkdtemp(prefix="sfid-kernels-") if "NUMBA_CACHE_DIR" not in os.environ else ""
    keep_machine_code(Path(kept or os.environ["NUMBA_CACHE_DIR"]))
    compile_s, _ = our_steps(xsb, 2, fast=True)
    rates: dict[str, list[float]] = {"researcher": [], "compiled": [], "without a compiler": []}
    whole: list[float] = []
    plain_seeds = max(50, seeds // 5)
    for _ in range(rounds):
        began = perf_counter()
        steps = researcher.run(researcher_seeds)
        rates["researcher"].append(steps / (perf_counter() - began))
        seconds, steps = our_steps(xsb, seeds, fast=True)
        whole.append(seconds)
        rates["compiled"].append(steps / seconds)
        seconds, steps = our_steps(xsb, plain_seeds, fast=False)
        rates["without a compiler"].append(steps / seconds)
    ratios = {
        name: median(ours / theirs for ours, theirs in zip(rates[name], rates["researcher"], strict=True))
        for name in BARS
    }
    floor = median(rates["researcher"])
    return {
        "experiment": f"figure2: 4 conditions, {seeds} seeds, {EPISODES} episodes",
        "steps_per_second": {name: round(median(values)) for name, values in rates.items()},
        "ratios": {name: round(ratio, 1) for name, ratio in ratios.items()},
        "bars": BARS,
        "baseline_fair": floor >= FLOOR_STEPS_S,
        "met": {name: ratios[name] >= bar for name, bar in BARS.items()},
        "seconds": {
            "compiled, all seeds": round(median(whole), 3),
            "first run, compiling": round(compile_s, 1),
        },
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="The whole experiment, ours beside a researcher's loop.")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--rounds", type=int, default=5, help="paired rounds (default 5)")
    parser.add_argument("--seeds", type=int, default=1_000, help="our seeds (default 1000)")
    parser.add_argument(
        "--researcher-seeds", type=int, default=20, help="seeds of the researcher's loop (default 20)"
    )
    options = parser.parse_args()
    result = measure(options.rounds, options.seeds, options.researcher_seeds)
    if options.json:
        print(json.dumps(result, indent=2))
        return
    for title, rows in result.items():
        print(f"{title}: {rows}" if not isinstance(rows, dict) else title)
        for name, value in rows.items() if isinstance(rows, dict) else ():
            print(f"  {name:25} {value:>14}")


if __name__ == "__main__":
    main()
