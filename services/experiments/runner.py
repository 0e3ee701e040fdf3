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
    first: int
    """Place of its first seed among all."""
    seeds: tuple[int, ...]


class _Done:
    """The results so far, each chunk in its place, and who is told of them."""

    def __init__(self, conditions: int, seeds: int, progress: Progress) -> None:
        self.results: list[Results | None] = [None] * conditions
        self._seeds, self._progress, self._counted = seeds, progress, 0

    def put(self, task: _Task, found: Results) -> None:
        """Take the results of a task, which may be written over afterwards."""
        table = self.results[task.condition]
        if table is None:
            table = self.results[task.condition] = np.empty((self._seeds, *found.shape[1:]))
        table[task.first : task.first + len(task.seeds)] = found
        self._counted += len(task.seeds)

    def tell(self) -> None:
        """Tell how many seeds are done."""
        self._progress(self._counted, self._seeds * len(self.results))


def run_conditions(
    conditions: Sequence[Runnable], seeds: Sequence[int], config: RunnerConfig, progress: Progress
) -> list[Results]:
    """Run every condition over every seed; return each condition's results over all seeds.

    Raises: ParameterError, LevelError, WorldError.
    """
    fast = compiler_available() if config.fast is None else config.fast
    store = ChunkStore(config.store)
    done = _Done(len(conditions), len(seeds), progress)
    tasks = []
    for task in _tasks(conditions, seeds, fast=fast):
        kept = store.load(conditions[task.condition], task.seeds)
        if kept is None:
            tasks.append(task)
        else:
            done.put(task, kept)
    done.tell()
    with _executor(config.workers or os.cpu_count() or 1, fast=fast) as pool:
        waiting: dict[Future[Results], _Task] = {
            pool.submit(_run_chunk, conditions[task.condition], task.seeds, fast): task for task in tasks
        }
        try:
            for future in as_completed(waiting):
                task, found = waiting.pop(future), future.result()
                store.save(conditions[task.condition], task.seeds, found)
                done.put(task, found)
                done.tell()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [results for results in done.results if results is not None]


def _tasks(conditions: Sequence[Runnable], seeds: Sequence[int], *, fast: bool) -> Iterator[_Task]:
    for number, condition in enumerate(conditions):
        together = condition.seeds_at_once(fast=fast)
        for first in range(0, len(seeds), together):
            yield _Task(number, first, tuple(seeds[first : first + together]))


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
    if getattr(_prepared, "condition", None) is not condition:
        # Whatever crosses processes is never the same object again.
        key = (condition.digest, fast)
        if getattr(_prepared, "key", None) != key:
            _prepared.batch, _prepared.key = condition.batch(fast=fast), key
        _prepared.condition = condition
    return _prepared.batch
