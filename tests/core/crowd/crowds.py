"""Seeded crowds whose members' reliability is known, and the public label sets where they are present."""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sfid_core.crowd.labels import Name

K = 4
DATA = Path(__file__).parents[4] / "shared" / "data"
"""Beside the project, never part of it."""

ADVERSARY, SPAMMER = 0.0, 1 / K
"""Accuracies: always wrong (at random among the wrong), and right by chance alone."""


class Decision(NamedTuple):
    """A decision of a crowd: the labels given, and the right one."""

    labels: dict[str, int | None]
    truth: int


def decisions(accuracies: Sequence[float], seed: int, count: int = 200, k: int = K) -> Iterator[Decision]:
    """Yield decisions that everybody labels; errors fall evenly on the wrong actions."""
    chance = np.random.default_rng(seed)
    for _ in range(count):
        truth = int(chance.integers(k))
        wrong = [(truth + 1 + int(draw)) % k for draw in chance.integers(k - 1, size=len(accuracies))]
        right = chance.random(len(accuracies)) < accuracies
        named: list[int | None] = [truth if good else other for good, other in zip(right, wrong, strict=True)]
        yield Decision({f"w{number}": label for number, label in enumerate(named)}, truth)


class Columns(NamedTuple):
    """A label set in columns, with the truth of those tasks where it is known."""

    tasks: list[str]
    workers: list[str]
    labels: list[str]
    truth: dict[Name, Name]


def real_set(name: str) -> Columns | None:
    """Return the public set of that name, None where it is absent."""
    labels, truth = DATA / f"{name}-labels.csv", DATA / f"{name}-truth.csv"
    if not labels.exists() or not truth.exists():
        return None
    with labels.open(newline="") as file:
        rows = [(row["task"], row["worker"], row["label"]) for row in csv.DictReader(file)]
    with truth.open(newline="") as file:
        known: dict[Name, Name] = {row["task"]: row["label"] for row in csv.DictReader(file)}
    tasks, workers, given = (list(column) for column in zip(*rows, strict=True))
    return Columns(tasks, workers, given, known)


def systematic_set(seed: int, tasks: int = 600, workers: int = 30, each: int = 5) -> Columns:
    """Return a set in which two workers of three call class 1 mostly 2: a confusion, not carelessness."""
    chance = np.random.default_rng(seed)
    careful = np.full((K, K), 0.05) + np.eye(K) * 0.8
    confused = careful.copy()
    confused[1] = (0.05, 0.2, 0.7, 0.05)
    rows = []
    truth: dict[Name, Name] = {}
    for task in range(tasks):
        right = int(chance.integers(K))
        truth[str(task)] = str(right)
        for worker in chance.choice(workers, each, replace=False).tolist():
            matrix = confused if worker % 3 else careful
            rows.append((str(task), f"w{worker:02}", str(int(chance.choice(K, p=matrix[right])))))
    names, people, given = (list(column) for column in zip(*rows, strict=True))
    return Columns(names, people, given, truth)


def sparse_set(seed: int, tasks: int = 500, workers: int = 200, each: int = 3) -> Columns:
    """Return a set of careful and careless workers with some seven labels each."""
    chance = np.random.default_rng(seed)
    accuracy = chance.beta(5, 2, workers)
    rows = []
    truth: dict[Name, Name] = {}
    for task in range(tasks):
        right = int(chance.integers(K))
        truth[str(task)] = str(right)
        for worker in chance.choice(workers, each, replace=False).tolist():
            wrong = (right + 1 + int(chance.integers(K - 1))) % K
            label = right if chance.random() < accuracy[worker] else wrong
            rows.append((str(task), f"w{worker:03}", str(label)))
    names, people, given = (list(column) for column in zip(*rows, strict=True))
    return Columns(names, people, given, truth)
