"""Crowd aggregation: ours beside crowd-kit in one run, and what a label costs online.

    python tests/benchmarks/crowd.py [--json] [--peers | --peer-python PYTHON] [--real FOLDER] [--rounds N]

Everyone gets the same integer columns task, worker, label in memory and is timed from there to one label a
task: in our case with finding out which tasks, workers and labels there are, in theirs with a data frame
made before. Both run on one thread, and what is compared is CPU time: on an idle machine the time on the
clock, on a busy one not what others take. One round runs both, one after the other; a ratio is the median
over rounds of theirs divided by ours in the same round.

--peers installs crowd-kit into a temporary environment, from the package index pip is set up for;
--peer-python names an interpreter that has it. Without either, or where it does not run, the report says so
and has our own figures alone. --real adds label sets of real people: FOLDER/NAME-labels.csv and
FOLDER/NAME-truth.csv, NAME-truth with the columns task, label.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from services.cli.crowd_files import read_labels, read_truth
from sfid_core.crowd.dawid_skene import dawid_skene
from sfid_core.crowd.labels import LabelSet, factorise, label_set
from sfid_core.crowd.one_coin import one_coin
from sfid_core.crowd.online import CrowdMethod, CrowdSettings, OnlineAggregate
from sfid_core.crowd.outcome import Outcome, decided

Ints = npt.NDArray[np.int64]
METHODS: dict[str, Callable[[LabelSet], Outcome]] = {"dawid-skene": dawid_skene, "one-coin": one_coin}
SYNTHETIC = {"10k": (1_000, 10, 10), "25k": (5_000, 50, 5), "500k": (100_000, 1_000, 5)}
"""Tasks, workers, labels a task."""
RATIO_SMALL_MIN, SMALL_MAX, RATIO_LARGE_MIN, ONLINE_US_MAX = 30, 25_000, 5, 25
PEER = """\
import json, sys, time
import numpy as np, pandas as pd
from crowdkit.aggregation import DawidSkene, OneCoinDawidSkene
methods = {"dawid-skene": DawidSkene, "one-coin": OneCoinDawidSkene}
print(json.dumps("ready"), flush=True)
for line in sys.stdin:
    path, method = json.loads(line)
    columns = np.load(path)
    data = pd.DataFrame({name: columns[name] for name in ("task", "worker", "label")})
    began = time.process_time()
    found = methods[method](n_iter=100).fit_predict(data)
    seconds = time.process_time() - began
    truth = columns["truth"]
    said = found.reindex(np.arange(len(truth))).to_numpy()
    known = truth >= 0
    print(json.dumps([seconds, float((said == truth)[known].mean())]), flush=True)
"""


class Columns(NamedTuple):
    """A label set; `truth` is by task, -1 where it is not known."""

    task: Ints
    worker: Ints
    label: Ints
    truth: Ints


class PeerUnavailableError(Exception):
    """crowd-kit cannot be installed or run, with the reason."""


class Peer:
    """crowd-kit in a process of its own: a set and a method in, seconds and accuracy out."""

    def __init__(self, python: str, folder: Path) -> None:
        script = folder / "peer.py"
        script.write_text(PEER, encoding="utf-8")
        self._errors = (folder / "errors.txt").open("w+", encoding="utf-8")
        try:
            self._process = subprocess.Popen(
                [python, "-W", "ignore", str(script)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, text=True,
            )  # fmt: skip
        except OSError as error:
            raise PeerUnavailableError(f"{python}: {error.strerror}") from None
        self._hear()

    def run(self, path: Path, method: str) -> tuple[float, float]:
        """Return seconds and accuracy."""
        if self._process.stdin is None:
            raise PeerUnavailableError("no pipe")
        self._process.stdin.write(json.dumps([str(path), method]) + "\n")
        self._process.stdin.flush()
        seconds, accuracy = self._hear()
        return float(seconds), float(accuracy)

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()
        self._errors.close()

    def _hear(self) -> Any:  # noqa: ANN401 - what the other side says in JSON
        line = self._process.stdout.readline() if self._process.stdout else ""
        if line:
            return json.loads(line)
        self._process.wait(10)
        self._errors.seek(0)
        lines = self._errors.read().strip().splitlines()
        raise PeerUnavailableError(lines[-1][:200] if lines else "it ended without a word")


@contextmanager
def peer_python(named: str | None, *, install: bool) -> Iterator[str]:
    """Yield an interpreter that has crowd-kit."""
    if named or not install:
        if not named:
            raise PeerUnavailableError("not asked for: give --peers or --peer-python PYTHON")
        yield named
        return
    with tempfile.TemporaryDirectory(prefix="sfid-peer-") as folder:
        print("installing crowd-kit ...", file=sys.stderr)
        venv.create(folder, with_pip=True)
        python = str(Path(folder) / "bin" / "python")
        command = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "crowd-kit"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
        if done.returncode:
            raise PeerUnavailableError(f"not installable: {done.stderr.strip().splitlines()[-1][:200]}")
        yield python


def synthetic(tasks: int, workers: int, each: int, seed: int = 0) -> Columns:
    """Return labels of workers whose accuracy lies between 0.4 and 0.95, four classes."""
    chance = np.random.default_rng(seed)
    truth = chance.integers(4, size=tasks)
    accuracy = chance.uniform(0.4, 0.95, workers)
    task = np.repeat(np.arange(tasks), each)
    first = np.repeat(chance.integers(workers, size=tasks), each)
    stride = np.repeat(chance.integers(1, max(workers // each, 2), size=tasks), each)
    worker = (first + stride * np.tile(np.arange(each), tasks)) % workers
    right = chance.random(len(task)) < accuracy[worker]
    label = np.where(right, truth[task], (truth[task] + 1 + chance.integers(3, size=len(task))) % 4)
    return Columns(task, worker, label, truth)


def real(folder: Path) -> Iterator[tuple[str, Columns]]:
    """Yield the label sets of a folder by name."""
    for path in sorted(folder.glob("*-labels.csv")):
        name = path.name.removesuffix("-labels.csv")
        rows = read_labels(path)
        known = read_truth(path.with_name(f"{name}-truth.csv"))
        tasks, task = factorise(rows.tasks)
        _, worker = factorise(rows.workers)
        classes, label = factorise(rows.labels)
        places = {text: index for index, text in enumerate(classes)}
        truth = np.array([places.get(known.get(str(one), ""), -1) for one in tasks])
        yield name, Columns(task, worker, label, truth)


def ours(columns: Columns, method: str) -> tuple[float, float]:
    """Return seconds and accuracy."""
    began = process_time()
    labels = label_set(columns.task, columns.worker, columns.label)
    classes = decided(METHODS[method](labels).posterior, labels.task_names, seed=0)
    seconds = process_time() - began
    said = np.full(len(columns.truth), -2)
    said[np.array(labels.task_names)] = [labels.class_names[index] for index in classes if index is not None]
    known = columns.truth >= 0
    return seconds, float((said == columns.truth)[known].mean())


def batch(sets: dict[str, Columns], rounds: int, peer: Peer | None, folder: Path) -> list[dict[str, Any]]:
    """Return one row a set and method."""
    report = []
    for name, columns in sets.items():
        path = folder / f"{name}.npz"
        np.savez(path, **columns._asdict())
        for method in METHODS:
            mine, theirs = [], []
            for _ in range(rounds):
                mine.append(ours(columns, method))
                if peer is not None:
                    theirs.append(peer.run(path, method))
            row = {
                "set": name, "labels": len(columns.task), "method": method,
                "ms": median(seconds for seconds, _ in mine) * 1e3, "accuracy": mine[0][1],
            }  # fmt: skip
            if theirs:
                row["crowd_kit_ms"] = median(seconds for seconds, _ in theirs) * 1e3
                row["crowd_kit_accuracy"] = theirs[0][1]
                row["ratio"] = median(b / a for (a, _), (b, _) in zip(mine, theirs, strict=True))
            report.append(row)
    return report


def online(sets: dict[str, Columns], rounds: int) -> list[dict[str, Any]]:
    """Return what a label costs decision by decision: concluding and learning, refreshes included."""
    report = []
    for name, columns in sets.items():
        decisions: dict[int, dict[str, int | None]] = {}
        for task, worker, label in zip(*(column.tolist() for column in columns[:3]), strict=True):
            decisions.setdefault(task, {})[f"w{worker}"] = label
        for method in CrowdMethod:
            costs, pauses = zip(
                *(streamed(list(decisions.values()), method) for _ in range(rounds)), strict=True
            )
            report.append({
                "set": name, "labels": len(columns.task), "method": method.value,
                "us_a_label": median(costs), "longest_decision_ms": median(pauses),
            })  # fmt: skip
    return report


def streamed(decisions: list[dict[str, int | None]], method: CrowdMethod) -> tuple[float, float]:
    """Return us a label over the whole stream, and ms of the longest decision."""
    aggregate = OnlineAggregate(4, CrowdSettings(method=method))
    longest = 0.0
    began = before = process_time()
    for labels in decisions:
        aggregate.conclude(labels)
        aggregate.learn(labels)
        now = process_time()
        longest, before = max(longest, now - before), now
    return (before - began) / sum(map(len, decisions)) * 1e6, longest * 1e3


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Run everything and return the report."""
    sets = {name: synthetic(*shape) for name, shape in SYNTHETIC.items()}
    if options.real is not None:
        sets |= dict(real(options.real))
    unavailable = {}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="sfid-crowd-")))
        peer = None
        try:
            python = stack.enter_context(peer_python(options.peer_python, install=options.peers))
            peer = Peer(python, folder)
            stack.callback(peer.close)
        except PeerUnavailableError as error:
            unavailable["crowd-kit"] = str(error)
        in_batch = batch(sets, options.rounds, peer, folder)
    small = {name: columns for name, columns in sets.items() if len(columns.task) <= SMALL_MAX}
    live = online(small, options.rounds)
    return {"batch": in_batch, "online": live, "meets": meets(in_batch, live), "unavailable": unavailable}


def meets(in_batch: list[dict[str, Any]], live: list[dict[str, Any]]) -> dict[str, bool]:
    """Return which of the bars are met; those without crowd-kit's figures are left out."""
    full = [row for row in in_batch if row["method"] == "dawid-skene" and "ratio" in row]
    small = [row["ratio"] for row in full if row["labels"] <= SMALL_MAX]
    large = [row["ratio"] for row in full if row["labels"] > SMALL_MAX]
    found = {
        f"a label online within {ONLINE_US_MAX} us": all(row["us_a_label"] <= ONLINE_US_MAX for row in live)
    }
    if full:
        near = all(abs(row["accuracy"] - row["crowd_kit_accuracy"]) <= 0.005 for row in full)
        found |= {
            f"{RATIO_SMALL_MIN} times faster up to {SMALL_MAX:,} labels": min(small) >= RATIO_SMALL_MIN,
            f"{RATIO_LARGE_MIN} times faster at 500,000 labels": min(large) >= RATIO_LARGE_MIN,
            "accuracy within 0.005": near,
        }
    return found


def show(report: dict[str, Any]) -> None:
    """Print the report as tables."""
    for title in ("batch", "online"):
        print(title)
        for row in report[title]:
            cells = (f"{key} {value:.4g}" for key, value in row.items() if isinstance(value, float))
            print(f"  {row['set']:6} {row['labels']:>8,} {row['method']:12} {', '.join(cells)}")
    for bar, met in report["meets"].items():
        print(f"{'met' if met else 'MISSED'}: {bar}")
    for name, reason in report["unavailable"].items():
        print(f"without {name}: {reason}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Crowd aggregation, ours beside crowd-kit.")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--peers", action="store_true", help="install crowd-kit and run it too")
    parser.add_argument("--peer-python", help="an interpreter that has crowd-kit")
    parser.add_argument("--real", type=Path, help="folder of NAME-labels.csv and NAME-truth.csv")
    parser.add_argument("--rounds", type=int, default=5, help="paired rounds (default 5)")
    report = measure(options := parser.parse_args())
    if options.json:
        print(json.dumps(report, indent=2))
    else:
        show(report)


if __name__ == "__main__":
    main()
