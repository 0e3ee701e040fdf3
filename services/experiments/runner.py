"""Runs the conditions of an experiment over seeds, on all cores, and takes up what was interrupted."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import parent_process
from multiprocessing.connection import wait
from pathlib import Path
from threading import Thread, local
from typing import Any, NamedTuple

import numpy as np

from services.experiments.chunks import ChunkStore
from services.experiments.runnable import Runnable
from sfid_core.compiled import compiler_available
from sfid_core.experiments.condition import Results

CHUNK_SEEDS = 50
"""Seeds that are run, kept and counted together."""

Progress = Callable[[int, int], None]
"""Told how many seeds of all conditions are done, and of how many."""


@dataclass(frozen=True, slots=True)
class RunnerConfig:
    """How an experiment is run; the results do not depend on any of it."""

    workers: int = 0
    """Threads (compiled) or processes (not); 0 means one a core."""
    fast: bool | None = None
    """Compile the kernels; None means where numba is installed."""
    store: Path | None = None
    """Folder that keeps finished chunks, so that an interrupted run goes on; None keeps nothing."""


class _Task(NamedTuple):
    condition: int
    seeds: tuple[int, ...]


def run_conditions(
    conditions: Sequence[Runnable], seeds: Sequence[int], config: RunnerConfig, progress: Progress
) -> list[Results]:
    """Run every condition over every seed; return each condition's results over all seeds.

    Raises: ParameterError, LevelError, WorldError.
    """
    fast = compiler_available() if config.fast is None else config.fast
    store = ChunkStore(config.store)
    tasks = list(_tasks(len(conditions), seeds))
    done: dict[_Task, Results] = {}
    for task in tasks:
        kept = store.load(conditions[task.condition], task.seeds)
        if kept is not None:
            done[task] = kept
    total = len(conditions) * len(seeds)
    progress(sum(len(task.seeds) for task in done), total)
    with _executor(config.workers or os.cpu_count() or 1, fast=fast) as pool:
        waiting: dict[Future[Results], _Task] = {
            pool.submit(_run_chunk, conditions[task.condition], task.seeds, fast): task
            for task in tasks
            if task not in done
        }
        try:
            for future in as_completed(waiting):
                task = waiting[future]
                done[task] = future.result()
                store.save(conditions[task.condition], task.seeds, done[task])
                progress(sum(len(each.seeds) for each in done), total)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [
        np.concatenate([done[task] for task in tasks if task.condition == number])
        for number in range(len(conditions))
    ]


def _tasks(conditions: int, seeds: Sequence[int]) -> Iterator[_Task]:
    for number in range(conditions):
        for first in range(0, len(seeds), CHUNK_SEEDS):
            yield _Task(number, tuple(seeds[first : first + CHUNK_SEEDS]))


def _executor(workers: int, *, fast: bool) -> Executor:
    """Compiled kernels release the interpreter's lock, so threads do; Python itself needs processes."""
    return ThreadPoolExecutor(workers) if fast else ProcessPoolExecutor(workers, initializer=_end_with_parent)


def _end_with_parent() -> None:
    """Let a worker end when the experiment is killed: its queue would never tell, for it holds both ends."""
    parent = parent_process()
    if parent is not None:
        Thread(target=_follow, args=(parent.sentinel,), daemon=True).start()


def _follow(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


_prepared = local()


def _run_chunk(condition: Runnable, seeds: tuple[int, ...], fast: bool) -> Results:  # noqa: FBT001 - crosses processes
    return condition.run(_batch(condition, fast=fast), seeds)


def _batch(condition: Runnable, *, fast: bool) -> Any:  # noqa: ANN401 - each kind has its own
    """Return this worker's batch of a condition; the latest one is kept, for its chunks come in a row."""
    key = (condition.digest, fast)
    if getattr(_prepared, "key", None) != key:
        _prepared.batch, _prepared.key = condition.batch(fast=fast), key
    return _prepared.batch
