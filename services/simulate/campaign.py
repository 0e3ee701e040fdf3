"""Many seeds, each run and judged; a lesson without faults is run once, and what is learnt must equal it."""

import gc
import logging
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from hashlib import sha256
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from services.runtime.faults import Seen
from services.simulate.evidence import Evidence, gather
from services.simulate.rules import RULES
from services.simulate.scenario import (
    LESSONS,
    SEEDS_A_SET,
    Lesson,
    Scenario,
    lesson,
    lesson_of,
    scenario,
    shortened,
    undisturbed,
)
from services.simulate.stage import Stage

SHOWN_A_RULE = 3
"""Lines told of one rule in one seed: what follows is mostly the same."""
BATCH = 8
SLACK = 1.35
"""How much longer a long lesson is that takes another course under faults: it is to be as long as asked."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A rule that did not hold."""

    seed: int
    rule: str
    what: str
    decisions: int = 0

    @property
    def repeat(self) -> str:
        """The command that shows it again."""
        long = f" --decisions {self.decisions}" if self.decisions else ""
        return f"sfid simulate --seed {self.seed}{long} --trace"


@dataclass(frozen=True, slots=True)
class Judged:
    """What came of one seed."""

    seed: int
    failures: tuple[Failure, ...]
    decisions: int
    """Steps in its journal."""
    steps: int
    """That were published, again after a restart too."""
    events: int
    faults: int
    trace_sha256: str
    seen: tuple[Seen, ...] = ()


@dataclass(slots=True)
class Campaign:
    """What came of all seeds."""

    seeds: int = 0
    failures: list[Failure] = field(default_factory=list)
    fewest_decisions: int = 0
    """Of all seeds."""
    steps: int = 0
    events: int = 0
    faults: int = 0
    seconds: float = 0.0
    trace_sha256: str = ""

    def add(self, judged: Judged) -> None:
        """Take one seed in; the order of seeds decides the digest of the traces."""
        self.fewest_decisions = min(self.fewest_decisions or judged.decisions, judged.decisions)
        self.seeds += 1
        self.failures += judged.failures
        self.steps += judged.steps
        self.events += judged.events
        self.faults += judged.faults
        self.trace_sha256 = sha256(f"{self.trace_sha256}{judged.trace_sha256}".encode()).hexdigest()


class Calm(NamedTuple):
    """A lesson without faults: all seeds that teach it are held to this."""

    lesson: Lesson
    """As long as asked, and not much longer."""
    learned: str
    """Digest of what is learnt."""
    watched: str
    """The same, with somebody watching."""


@lru_cache(LESSONS)
def calm(number: int, decisions: int = 0) -> Calm:
    """Return a lesson as it goes without faults."""
    taught = lesson(number, decisions)
    if decisions:
        wanted = int(decisions * (1 if taught.exact else SLACK))
        taken = list(_played(undisturbed(taught)).last_steps.values())
        taught = shortened(taught, taken[min(wanted, len(taken)) - 1].episode + 1)
    bare = undisturbed(taught)
    return Calm(taught, _digest(bare), _digest(bare.watched()))


def judge(seed: int, decisions: int = 0, *, trace: bool = False, held_to: Calm | None = None) -> Judged:
    """Run one seed and check every rule; `trace` keeps what was seen.

    Args: decisions: about so many at least, with three teachers; 0 is a short lesson. held_to: its lesson
    without faults, if that is known.
    """
    with _at_work():
        held_to = held_to or calm(lesson_of(seed), decisions)
        drawn = replace(scenario(seed, decisions), lesson=held_to.lesson)
        return _judged_scenario(drawn, held_to, decisions, trace=trace)


@contextmanager
def _at_work() -> Iterator[None]:
    """Have services log nothing, and no garbage looked for: a session's objects die with it."""
    log = logging.getLogger("sfid")
    level, collects = log.level, gc.isenabled()
    log.setLevel(logging.CRITICAL + 1)
    gc.disable()
    try:
        yield
    finally:
        log.setLevel(level)
        if collects:
            gc.enable()


def _judged_scenario(drawn: Scenario, held_to: Calm, decisions: int, *, trace: bool) -> Judged:
    seed, evidence = drawn.seed, _played(drawn)
    failures = [
        Failure(seed, rule, what, decisions)
        for rule, check in RULES.items()
        for what in tuple(check(evidence))[:SHOWN_A_RULE]
    ]
    compared = _compared(drawn, evidence, held_to)
    failures += [Failure(seed, rule, what, decisions) for rule, what in compared]
    history = evidence.history
    return Judged(
        seed,
        tuple(failures),
        len(evidence.transitions()),
        len(evidence.steps),
        history.appointments,
        history.faults,
        history.trace_sha256,
        tuple(history.seen) if trace else (),
    )


def campaign(first: int, seeds: int, jobs: int = 1, decisions: int = 0) -> Iterator[tuple[Campaign, Judged]]:
    """Judge seeds first, first + 1 ... and yield the sums so far after each; `jobs` processes share them."""
    started, sums = time.monotonic(), Campaign()
    for judged in _judged(range(first, first + seeds), jobs, decisions):
        sums.add(judged)
        sums.seconds = time.monotonic() - started
        yield sums, judged


def _judged(seeds: range, jobs: int, decisions: int) -> Iterator[Judged]:
    if jobs == 1 or len(seeds) < 2 * BATCH:
        yield from map(partial(judge, decisions=decisions), seeds)
        return
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    ignore = (signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asked
    with ProcessPoolExecutor(jobs, context, signal.signal, ignore) as pool:
        for _, together in groupby(seeds, lambda seed: seed // SEEDS_A_SET):
            block = list(together)
            numbers = list(dict.fromkeys(map(lesson_of, block)))
            # Each lesson once, by whichever process, before the seeds that are held to it.
            bare = dict(zip(numbers, pool.map(partial(_calm, decisions), numbers), strict=True))
            tasks = [(seed, bare[lesson_of(seed)]) for seed in block]
            yield from pool.map(partial(_judge, decisions), tasks, chunksize=BATCH)


def _calm(decisions: int, number: int) -> Calm:
    with _at_work():
        return calm(number, decisions)


def _judge(decisions: int, task: tuple[int, Calm]) -> Judged:
    return judge(task[0], decisions, held_to=task[1])


def _played(drawn: Scenario) -> Evidence:
    memory = Path("/dev/shm")  # noqa: S108 - files in memory where there are such: power cuts are simulated
    with tempfile.TemporaryDirectory(
        prefix="sfid-", dir=memory if os.access(memory, os.W_OK) else None
    ) as root:
        return gather(Stage(drawn, Path(root)).play())


def _digest(drawn: Scenario) -> str:
    report = _played(drawn).report
    return report.q_sha256 if report is not None else "not finished"


def _compared(drawn: Scenario, evidence: Evidence, held_to: Calm) -> Iterator[tuple[str, str]]:
    """R10, and the promise that faults do not change what is learnt where everybody is waited for.

    A crowd is left out of R10: which of its workers answers before the quorum closes a round is a race of
    microseconds, which a viewer may turn as everything else does.
    """
    expected, watched = held_to.learned, held_to.watched
    if watched != expected and not drawn.lesson.crowd:
        yield "R10", f"without faults {expected[:12]} is learnt, with a viewer {watched[:12]}"
    if not drawn.lesson.exact or evidence.report is None or evidence.report.q_sha256 == expected:
        return
    found = evidence.report.q_sha256
    rule = "R10" if _digest(drawn.unwatched()) == expected else "R3"
    yield rule, f"{found[:12]} is learnt, without faults and viewer {expected[:12]}"
