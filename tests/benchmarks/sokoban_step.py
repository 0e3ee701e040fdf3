"""Sokoban steps per second: ours beside a researcher's plain NumPy and, with --peers, beside other packages.

    python tests/benchmarks/sokoban_step.py [--json] [--peers] [--rounds N] [--seconds S]

Everyone plays the same 10 x 10 level with four boxes by uniformly random actions, starts again when it is
solved and after 120 steps, and renders nothing. One round runs every contestant once, one after the other;
a ratio is the median over rounds of ours divided by theirs in the same round, so that a busy machine slows
both.

--peers installs each package into a temporary environment of its own, from the package index pip is set up
for, and plays it in a process of its own; one that cannot be installed or played is reported with the reason.
The batched loop over the table is there in C too, built by the machine's `cc`, where there is one.
"""

import argparse
import ctypes
import json
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
import numpy.typing as npt

from sfid_core.mdp import StateOutcome
from sfid_core.sokoban.actions import ACTIONS, DELTAS
from sfid_core.sokoban.levels import parse_levels
from sfid_core.sokoban.rules import step
from sfid_core.sokoban.tables import StateTable, build_table

LEVEL_XSB = """\
##########
##  #   ##
##  $ . ##
### # ####
### $  ###
## .@$  ##
## .   ###
### $ ####
###. #####
##########"""
EPISODE_STEPS = 120
BATCH = 4096
LEVEL = parse_levels(LEVEL_XSB)[0]
PEERS = Path(__file__).with_name("sokoban_peers.toml")
"""How each peer is played: programs for environments that hold only that package."""

C_BATCH = "C table batch"
BARS = {"sfid table batch / jumanji scan": 20.0, f"sfid table batch / {C_BATCH}": 1 / 3}
"""What the ratios have to reach: 20 times jumanji, and within 3 times of C."""

Play = Callable[[int], float]
"""Plays at least so many steps and returns the seconds it took per step."""


def table_scalar(table: StateTable, solved: npt.NDArray[np.uint8]) -> Play:
    """One state at a time over the successor table, in plain Python."""
    successor, is_solved = table.successor.reshape(-1).data, solved.data
    start = table.state_id(LEVEL.start)

    def play(steps: int) -> float:
        actions = random_actions(steps).tolist()
        state, left = start, EPISODE_STEPS
        began = perf_counter()
        for action in actions:
            state = successor[state * 4 + action]
            left -= 1
            if is_solved[state] or not left:
                state, left = start, EPISODE_STEPS
        return (perf_counter() - began) / steps

    return play


def board_scalar(steps: int) -> float:
    """One board at a time by the rules alone: what a level beyond the tables costs."""
    actions = [ACTIONS[action] for action in random_actions(steps).tolist()]
    board, left = LEVEL.start, EPISODE_STEPS
    began = perf_counter()
    for action in actions:
        board, _, pushed = step(board, action)
        left -= 1
        if (pushed and board.solved) or not left:
            board, left = LEVEL.start, EPISODE_STEPS
    return (perf_counter() - began) / steps


def table_batch(table: StateTable, solved: npt.NDArray[np.uint8]) -> Play:
    """4096 states at once: step, look up the outcome, start the solved ones again."""
    # A row of four successors is found at 4 * state: kept multiplied, one addition finds the entry. A solved
    # one carries a flag above all entries, so that one maximum tells whether any lane has ended.
    ended = np.int64(1) << 40
    after = table.successor.reshape(-1)
    successor = after.astype(np.int64) * 4 + np.where(solved[after] != 0, ended, np.int64(0))
    start = table.state_id(LEVEL.start) * 4

    def play(steps: int) -> float:
        actions = random_actions(EPISODE_STEPS * BATCH).astype(np.int64).reshape(EPISODE_STEPS, BATCH)
        rounds = -(-steps // actions.size)
        entry = np.empty(BATCH, dtype=np.int64)
        began = perf_counter()
        for _ in range(rounds):
            states = np.full(BATCH, start)
            for action in actions:
                np.add(states, action, out=entry)
                np.take(successor, entry, out=states, mode="clip")
                if states.max() >= ended:
                    states[states >= ended] = start
        return (perf_counter() - began) / (rounds * actions.size)

    return play


def plain_scalar(steps: int) -> float:
    """What a researcher writes first: a NumPy grid, moved cell by cell, copied for every step."""
    first = np.array([list(row) for row in LEVEL_XSB.split("\n")])
    goals = np.isin(first, [".", "+", "*"])
    walls = first == "#"
    boxes_first = np.isin(first, ["$", "*"])
    player_first = np.argwhere(first == "@")[0]
    deltas = np.array(DELTAS)
    actions = random_actions(steps)
    boxes, player, left = boxes_first.copy(), player_first, EPISODE_STEPS
    began = perf_counter()
    for action in actions:
        target = player + deltas[action]
        beyond = target + deltas[action]
        left -= 1
        if boxes[tuple(target)] and not walls[tuple(beyond)] and not boxes[tuple(beyond)]:
            boxes = boxes.copy()
            boxes[tuple(target)], boxes[tuple(beyond)] = False, True
            player = target
        elif not walls[tuple(target)] and not boxes[tuple(target)]:
            player = target
        if not left or bool((boxes & ~goals).sum() == 0):
            boxes, player, left = boxes_first.copy(), player_first, EPISODE_STEPS
    return (perf_counter() - began) / steps


def plain_batch(steps: int) -> float:
    """The same in a batch: 4096 grids of boxes, moved by fancy indexing."""
    glyphs = np.array(list(LEVEL_XSB.replace("\n", "")))
    walls, goals = glyphs == "#", np.isin(glyphs, [".", "+", "*"])
    boxes_first, player_first = np.isin(glyphs, ["$", "*"]), int(np.flatnonzero(glyphs == "@")[0])
    strides = np.array([row * LEVEL.width + column for row, column in DELTAS])
    actions = random_actions(EPISODE_STEPS * BATCH).reshape(EPISODE_STEPS, BATCH)
    rounds = -(-steps // actions.size)
    rows = np.arange(BATCH)
    began = perf_counter()
    for _ in range(rounds):
        boxes, player = np.tile(boxes_first, (BATCH, 1)), np.full(BATCH, player_first)
        for action in actions:
            target = player + strides[action]
            beyond = np.where(walls[target], target, target + strides[action])
            on_box = boxes[rows, target]
            pushes = on_box & ~walls[beyond] & ~boxes[rows, beyond]
            boxes[rows[pushes], target[pushes]] = False
            boxes[rows[pushes], beyond[pushes]] = True
            player = np.where(~walls[target] & (~on_box | pushes), target, player)
            solved = ~(boxes & ~goals).any(axis=1)
            boxes[solved] = boxes_first
            player[solved] = player_first
    return (perf_counter() - began) / (rounds * actions.size)


def random_actions(count: int) -> npt.NDArray[np.int64]:
    """Draw the actions of one measurement, outside its clock."""
    return np.random.default_rng(0).integers(4, size=count)


@dataclass
class Contestant:
    """Someone who plays: a function here, or a peer's process; calibrated to a fixed span a round."""

    name: str
    batched: bool
    play: Play
    steps: int = 0
    rates: list[float] = field(default_factory=list)

    def calibrate(self, seconds: float) -> None:
        """Choose the steps of a round; the first play warms caches and compilers up."""
        self.play(2_000)
        self.steps = max(1_000, int(seconds / self.play(5_000)))

    def run(self) -> None:
        """Play one round."""
        self.rates.append(1.0 / self.play(self.steps))


C_SOURCE = """
#include <stdint.h>
/* Steps of a batch of states; solved ones start again. */
void play(const int32_t *successor, const uint8_t *solved, const int64_t *actions, int64_t n_steps,
          int64_t batch, int32_t start, int32_t *states) {
    for (int64_t step = 0; step < n_steps; step++)
        for (int64_t lane = 0; lane < batch; lane++) {
            int32_t after = successor[4 * states[lane] + actions[step * batch + lane]];
            states[lane] = solved[after] ? start : after;
        }
}
"""


def table_batch_in_c(table: StateTable, solved: npt.NDArray[np.uint8], folder: Path) -> Play:
    """The loop of `table_batch` in C; raises PeerUnavailableError where it cannot be built."""
    source, library = folder / "play.c", folder / "play.so"
    source.write_text(C_SOURCE, encoding="utf-8")
    try:
        command = ["cc", "-O3", "-march=native", "-shared", "-fPIC", "-o", str(library), str(source)]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    except (OSError, subprocess.SubprocessError) as error:
        raise PeerUnavailableError(f"not built: {error}") from None
    run = ctypes.CDLL(str(library)).play
    run.restype = None
    run.argtypes = [*[ctypes.c_void_p] * 3, *[ctypes.c_int64] * 2, ctypes.c_int32, ctypes.c_void_p]
    successor = np.ascontiguousarray(table.successor.reshape(-1))
    start = table.state_id(LEVEL.start)

    def play(steps: int) -> float:
        actions = random_actions(EPISODE_STEPS * BATCH)
        rounds = -(-steps // actions.size)
        states = np.empty(BATCH, dtype=np.int32)
        began = perf_counter()
        for _ in range(rounds):
            states[:] = start
            run(successor.ctypes.data, solved.ctypes.data, actions.ctypes.data, EPISODE_STEPS, BATCH, start,
                states.ctypes.data)  # fmt: skip
        return (perf_counter() - began) / (rounds * actions.size)

    return play


class PeerUnavailableError(Exception):
    """A peer that cannot be installed or played, with the reason."""


class Peer:
    """A package in an environment of its own, played over a pipe: steps in, seconds a step out."""

    def __init__(self, package: str, program: str, folder: Path) -> None:
        home = folder / package
        venv.create(home, with_pip=True)
        python = str(home / "bin" / "python")
        command = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", package]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        except subprocess.TimeoutExpired:
            raise PeerUnavailableError("not installable: pip took over 300 s") from None
        if done.returncode:
            raise PeerUnavailableError(f"not installable: {_reason(done.stderr)}")
        (home / "play.py").write_text(program, encoding="utf-8")
        self._errors = (home / "errors.txt").open("w+", encoding="utf-8")
        self._process = subprocess.Popen(
            [python, str(home / "play.py"), LEVEL_XSB, str(EPISODE_STEPS), str(BATCH)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )

    def play(self, steps: int) -> float:
        """Play so many steps over there."""
        process = self._process
        if process.stdin is None or process.stdout is None:
            raise PeerUnavailableError("not playable: no pipe")
        try:
            process.stdin.write(f"{steps}\n")
            process.stdin.flush()
            return float(process.stdout.readline())
        except (OSError, ValueError):
            process.wait(10)
            self._errors.seek(0)
            raise PeerUnavailableError(f"not playable: {_reason(self._errors.read())}") from None

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()
        self._errors.close()


def _reason(text: str) -> str:
    """Return the line of an error output that says most: the last that names an error, else the last."""
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("WARNING")]
    errors = [line for line in lines if "Error:" in line or line.startswith("ERROR:")]
    return [*lines, *errors][-1][:200] if lines else "no reason given"


def contestants_here(folder: Path, absent: dict[str, str]) -> list[Contestant]:
    """Return ours, the plain NumPy ones, and the one in C; why it is missing goes to `absent`."""
    table = build_table(LEVEL)
    goal_cells = np.isin(table.cells, np.array(LEVEL.goals))
    solved_ranks = goal_cells[table.boxes].all(axis=0)
    solved = np.repeat(solved_ranks, table.n_cells).astype(np.uint8) * np.uint8(StateOutcome.SOLVED)
    found = [
        Contestant("sfid table", batched=False, play=table_scalar(table, solved)),
        Contestant("sfid board", batched=False, play=board_scalar),
        Contestant("sfid table batch", batched=True, play=table_batch(table, solved)),
        Contestant("plain NumPy", batched=False, play=plain_scalar),
        Contestant("plain NumPy batch", batched=True, play=plain_batch),
    ]
    try:
        found.append(Contestant(C_BATCH, batched=True, play=table_batch_in_c(table, solved, folder)))
    except PeerUnavailableError as error:
        absent[C_BATCH] = str(error)
    return found


def measure(rounds: int, seconds: float, *, peers: bool) -> dict[str, object]:
    """Run all rounds and return the report."""
    running: list[Peer] = []
    absent: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="sfid-peers-") as folder:
        contestants = contestants_here(Path(folder), absent)
        for name, entry in tomllib.loads(PEERS.read_text(encoding="utf-8")).items() if peers else ():
            try:
                print(f"installing {name} ...", file=sys.stderr)
                peer = Peer(entry["package"], entry["program"], Path(folder))
                running.append(peer)
                peer.play(1_000)
                contestants.append(Contestant(name, batched=entry["batched"], play=peer.play))
            except PeerUnavailableError as error:
                absent[name] = str(error)
        try:
            for contestant in contestants:
                contestant.calibrate(seconds)
            for _ in range(rounds):
                for contestant in contestants:
                    contestant.run()
        finally:
            for peer in running:
                peer.close()
    return report(contestants, absent)


def report(contestants: list[Contestant], absent: dict[str, str]) -> dict[str, object]:
    """Return medians, and the ratios of ours over each other contestant of the same kind."""
    ours = {one.name: one for one in contestants if one.name.startswith("sfid")}
    ratios = {
        f"{own.name} / {other.name}": median(
            mine / theirs for mine, theirs in zip(own.rates, other.rates, strict=True)
        )
        for own in ours.values()
        for other in contestants
        if other.name not in ours and other.batched == own.batched
    }
    return {
        "level": f"10x10, 4 boxes, {EPISODE_STEPS} steps an episode, batch {BATCH}",
        "steps_per_second": {one.name: round(median(one.rates)) for one in contestants},
        "ratios": {name: round(ratio, 2) for name, ratio in ratios.items()},
        "bars": {name: round(bar, 3) for name, bar in BARS.items()},
        "met": {name: bool(ratios[name] >= bar) for name, bar in BARS.items() if name in ratios},
        "unavailable": absent,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Sokoban steps per second, ours beside others.")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--peers", action="store_true", help="install and play the field's packages too")
    parser.add_argument("--rounds", type=int, default=7, help="paired rounds (default 7)")
    parser.add_argument(
        "--seconds", type=float, default=0.5, help="seconds a contestant and round (default 0.5)"
    )
    options = parser.parse_args()
    result = measure(options.rounds, options.seconds, peers=options.peers)
    if options.json:
        print(json.dumps(result, indent=2))
        return
    for title in ("steps_per_second", "ratios", "met", "unavailable"):
        print(title)
        rows = result[title]
        for name, value in rows.items() if isinstance(rows, dict) else ():
            print(f"  {name:45} {value:>14,}" if isinstance(value, int) else f"  {name:45} {value:>14}")


if __name__ == "__main__":
    main()
