"""The founding paper's experiment beside a researcher's loop: Gymnasium, a defaultdict and NumPy.

    python tests/benchmarks/experiment.py [--json] [--seeds N] [--rounds N] [--researcher-seeds N]

All run the whole of figure 2: four conditions, 30 episodes, the room with one box, step cap 200, the four
measures of every episode. One round runs the researcher's loop over a few seeds, as it is usually written and
as one tunes it by hand (`researcher_loop.py`), and ours over all seeds, compiled and without a compiler; a
ratio is the median over rounds of their seconds a step divided by ours, so that a busy machine slows all. The
bars are held against the loop as it is usually written; the other ratios are told beside them. Compilation is
told apart: machine code is kept between runs.
"""

import argparse
import json
import os
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
from researcher_loop import Researcher, Room, TupleRoomEnv

from services.experiments.runner import RunnerConfig, run_conditions
from services.runtime.sources import keep_machine_code
from sfid_core.experiments import figure2
from sfid_core.experiments.condition import column, results_sha256
from sfid_core.session.config import WorldSpec
from sfid_core.sokoban.levels import packaged

FLOOR_STEPS_S = 15_000
"""Steps a second that the researcher's loop must reach, or it is no fair baseline."""
BARS = {"compiled": 1_000.0, "without a compiler": 10.0}
LOOP, TUNED = "researcher", "researcher, tuned"
FAST = {"compiled": True, "without a compiler": False}


class Ours:
    """Our experiment on all cores."""

    def __init__(self, xsb: str) -> None:
        self._conditions = figure2.conditions(WorldSpec(xsb, "room"))
        self.digests: set[str] = set()

    def run(self, seeds: int, *, fast: bool) -> tuple[float, int]:
        """Run all conditions; return (seconds, steps)."""
        began = perf_counter()
        results = run_conditions(
            self._conditions, range(seeds), RunnerConfig(fast=fast), lambda _done, _of: None
        )
        seconds = perf_counter() - began
        self.digests.add(f"{seeds} seeds: {results_sha256(results)}")
        return seconds, int(sum(column(one, "steps").sum() for one in results))


def measure(rounds: int, seeds: int, researcher_seeds: int) -> dict[str, object]:
    """Run all rounds and return the report."""
    xsb = packaged("room")[0].to_xsb()
    room, ours = Room(xsb), Ours(xsb)
    loops = {LOOP: Researcher(room), TUNED: Researcher(room, TupleRoomEnv)}
    kept = tempfile.mkdtemp(prefix="sfid-kernels-") if "NUMBA_CACHE_DIR" not in os.environ else ""
    keep_machine_code(Path(kept or os.environ["NUMBA_CACHE_DIR"]))
    compile_s, _ = ours.run(2, fast=True)
    rates: dict[str, list[float]] = {name: [] for name in (*loops, *BARS)}
    whole: dict[str, list[float]] = {name: [] for name in BARS}
    ours.digests.clear()
    for _ in range(rounds):
        for name, loop in loops.items():
            began = perf_counter()
            steps = loop.run(researcher_seeds)
            rates[name].append(steps / (perf_counter() - began))
        for name in BARS:
            seconds, steps = ours.run(seeds, fast=FAST[name])
            whole[name].append(seconds)
            rates[name].append(steps / seconds)
    ratios = {loop: {name: _ratio(rates[name], rates[loop]) for name in BARS} for loop in loops}
    same = all(np.array_equal(*[loop.measures(seed) for loop in loops.values()]) for seed in range(2))
    return {
        "experiment": f"figure2: 4 conditions, {seeds} seeds, {figure2.EPISODES} episodes",
        "steps_per_second": {name: round(median(values)) for name, values in rates.items()},
        "ratios": ratios[LOOP],
        "ratios to the tuned loop": ratios[TUNED],
        "bars": BARS,
        "met": {name: ratios[LOOP][name] >= bar for name, bar in BARS.items()},
        "baseline_fair": median(rates[LOOP]) >= FLOOR_STEPS_S,
        "loops have the same measures": same,
        "ours have one digest": len(ours.digests) == 1,
        "seconds": {
            **{f"{name}, all seeds": round(median(values), 3) for name, values in whole.items()},
            "first run, compiling": round(compile_s, 1),
        },
    }


def _ratio(ours: list[float], theirs: list[float]) -> float:
    return round(median(one / other for one, other in zip(ours, theirs, strict=True)), 1)


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
