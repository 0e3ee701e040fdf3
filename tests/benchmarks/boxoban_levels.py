"""Boxoban levels with exact distances: seconds, peak memory, and the compact tables of each.

    python tests/benchmarks/boxoban_levels.py [FILE ...] [--json] [--levels N] [--sample N]

FILE is any file of levels; without one, every Boxoban file of ../shared/data beside the project, and where
there is none, fifty generated rooms of 10 x 10 with four boxes.  Every level is built in a process of its
own (a fork, so that the peak of its memory includes interpreter and NumPy): first every distance to solved,
then the compact tables of `sfid_core.sokoban.live` from the level's own start.

The anchor, in the same run: a breadth-first search over tuples and a set, as one writes it in plain Python.
It finds the fewest steps from the start alone, where ours finds those of every state; both must agree.  It
plays --sample levels spread over all those with at most two million states, for it needs 300 bytes a state.
"""

import argparse
import json
import multiprocessing
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from multiprocessing.connection import Connection
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from statistics import median
from time import perf_counter

from sfid_core.sokoban.board import BLOCKED, Level
from sfid_core.sokoban.generator import Recipe, generate
from sfid_core.sokoban.levels import load_bytes
from sfid_core.sokoban.live import tabulate
from sfid_core.sokoban.tables import count_states
from sfid_core.sokoban.world import World, WorldConfig

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
TARGETS = {"seconds_median": 0.5, "seconds_worst": 5.0, "peak_mb_worst": 250.0}
GENERATED = 50
PLAIN_STATES_MAX = 2_000_000


@dataclass(frozen=True)
class Built:
    """One level as its process found it."""

    name: str
    states: int
    optimal_steps: int | None
    seconds: float
    peak_mb: float
    live_states: int
    tables_seconds: float
    tables_peak_mb: float


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--levels", type=int, default=0, help="at most so many of each file; 0 for all")
    parser.add_argument("--sample", type=int, default=10, help="levels that the plain search plays too")
    arguments = parser.parse_args()
    sources = levels_of(arguments.files or sorted(DATA.glob("*boxoban*.txt")), arguments.levels)
    built = []
    for number, (name, level) in enumerate(sources, start=1):
        built.append(in_its_own_process(name, level))
        if sys.stderr.isatty():
            print(f"\r{number} of {len(sources)} levels", end="", file=sys.stderr)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    report = {**summary(built), **against_plain(sources, built, arguments.sample)}
    if arguments.json:
        print(json.dumps({**report, "levels": [asdict(one) for one in built]}))
    else:
        print_report(report)


def levels_of(files: Sequence[Path], at_most: int) -> list[tuple[str, Level]]:
    """Return the levels to build, by name."""
    sources = {file.name: load_bytes(file.read_bytes(), str(file)) for file in files}
    if not sources:
        recipe = Recipe(10, 10, 4, 20, states_max=12_000_000)
        sources = {"generated": tuple(islice(generate(recipe, 0), GENERATED))}
    return [
        (f"{name}:{index}", level)
        for name, levels in sources.items()
        for index, level in enumerate(levels[: at_most or None])
    ]


def in_its_own_process(name: str, level: Level) -> Built:
    """Build a level in a fork of this process and return what it measured."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=build, args=(name, level, there))
    process.start()
    there.close()
    try:
        found: Built = here.recv()
    except EOFError:
        raise SystemExit(f"{name}: not built, its process says why") from None
    process.join()
    return found


def build(name: str, level: Level, answer: Connection) -> None:
    """Solve one level, tabulate it, and send the figures."""
    world = World(level, WorldConfig(), "1", 0)
    began = perf_counter()
    solution = world.solution
    seconds, peak_mb = perf_counter() - began, peak_megabytes()
    if solution is None:
        raise SystemExit(f"{name} has {count_states(level):,} states, too many to solve exactly")
    began = perf_counter()
    tables = tabulate(world)
    tables_seconds = perf_counter() - began
    steps = solution.distance(level.start)
    answer.send(
        Built(
            name, count_states(level), steps, seconds, peak_mb, tables.sink, tables_seconds, peak_megabytes()
        )
    )


def peak_megabytes() -> float:
    """Return the most memory this process has had, code and shared pages included."""
    return (
        getrusage(RUSAGE_SELF).ru_maxrss / 1000
        if sys.platform != "darwin"
        else getrusage(RUSAGE_SELF).ru_maxrss / 1e6
    )


def summary(built: Sequence[Built]) -> dict[str, float]:
    """Return the figures over all levels."""
    return {
        "count": len(built),
        "states_median": median(one.states for one in built),
        "states_most": max(one.states for one in built),
        "seconds_median": median(one.seconds for one in built),
        "seconds_worst": max(one.seconds for one in built),
        "peak_mb_median": median(one.peak_mb for one in built),
        "peak_mb_worst": max(one.peak_mb for one in built),
        "live_states_median": median(one.live_states for one in built),
        "tables_seconds_median": median(one.tables_seconds for one in built),
        "tables_seconds_worst": max(one.tables_seconds for one in built),
        "tables_peak_mb_worst": max(one.tables_peak_mb for one in built),
    }


def against_plain(
    sources: Sequence[tuple[str, Level]], built: Sequence[Built], sample: int
) -> dict[str, float]:
    """Play the sample in plain Python and return how many times longer that takes."""
    numbers = sorted(range(len(built)), key=lambda number: built[number].states)
    numbers = [number for number in numbers if built[number].states <= PLAIN_STATES_MAX]
    ratios, rates = [], []
    for number in numbers[:: max(1, len(numbers) // max(1, sample))][:sample]:
        level, ours = sources[number][1], built[number]
        began = perf_counter()
        steps, seen = plain_search(level)
        seconds = perf_counter() - began
        if steps != ours.optimal_steps:
            raise SystemExit(f"{ours.name}: {ours.optimal_steps} steps here, {steps} by the plain search")
        ratios.append(seconds / ours.seconds)
        rates.append(seen / seconds)
    if not ratios:
        return {}
    ours_rate = sum(one.states for one in built) / sum(one.seconds for one in built)
    return {
        "sample": len(ratios),
        "plain_seconds_ratio": median(ratios),
        "plain_states_per_second": median(rates),
        "states_per_second": ours_rate,
    }


def plain_search(level: Level) -> tuple[int | None, int]:
    """Return the fewest steps from the start (None without solution) and how many states were seen."""
    goals, neighbours = frozenset(level.goals), level.neighbours
    first = (level.player, frozenset(level.boxes))
    seen, frontier, steps = {first}, [first], 0
    while frontier:
        if any(boxes == goals for _, boxes in frontier):
            return steps, len(seen)
        following = []
        for player, boxes in frontier:
            for ahead in neighbours:
                target = ahead[player]
                if target == BLOCKED:
                    continue
                after = boxes
                if target in boxes:
                    landing = ahead[target]
                    if landing == BLOCKED or landing in boxes:
                        continue
                    after = boxes - {target} | {landing}
                state = (target, after)
                if state not in seen:
                    seen.add(state)
                    following.append(state)
        frontier, steps = following, steps + 1
    return None, len(seen)


def print_report(report: dict[str, float]) -> None:
    """Print the figures for people."""
    for name, value in report.items():
        target = TARGETS.get(name)
        verdict = "" if target is None else f"   target {target:g}: {'met' if value <= target else 'MISSED'}"
        print(
            f"{name:<26} {value:>16,.4g}{verdict}" if value < 1000 else f"{name:<26} {value:>16,.0f}{verdict}"
        )


if __name__ == "__main__":
    main()
