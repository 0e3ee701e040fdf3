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
from dataclasses import dataclass, field
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path

from services.runtime.faults import Seen
from services.simulate.evidence import Evidence, gather
from services.simulate.rules import RULES
from services.simulate.scenario import LESSONS, Scenario, lesson, lesson_of, scenario, undisturbed
from services.simulate.stage import Stage

SHOWN_A_RULE = 3
"""Lines told of one rule in one seed: what follows is mostly the same."""
BATCH = 8


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
    steps: int
    events: int
    faults: int
    trace_sha256: str
    seen: tuple[Seen, ...] = ()


@dataclass(slots=True)
class Campaign:
    """What came of all seeds."""

    seeds: int = 0
    failures: list[Failure] = field(default_factory=list)
    steps: int = 0
    events: int = 0
    faults: int = 0
    seconds: float = 0.0
    trace_sha256: str = ""

    def add(self, judged: Judged) -> None:
        """Take one seed in; the order of seeds decides the digest of the traces."""
        self.seeds += 1
        self.failures += judged.failures
        self.steps += judged.steps
        self.events += judged.events
        self.faults += judged.faults
        self.trace_sha256 = sha256(f"{self.trace_sha256}{judged.trace_sha256}".encode()).hexdigest()


def judge(seed: int, decisions: int = 0, *, trace: bool = False) -> Judged:
    """Run one seed and check every rule; `trace` keeps what was seen.

    Args: decisions: about so many at least, with three teachers; 0 is a short lesson.
    """
    logging.getLogger("sfid").setLevel(logging.CRITICAL + 1)
    drawn = scenario(seed, decisions)
    # A session's objects die with it; looking for garbage among them meanwhile costs a tenth of the time.
    gc.disable()
    try:
        return _judged_scenario(drawn, decisions, trace=trace)
    finally:
        gc.enable()


def _judged_scenario(drawn: Scenario, decisions: int, *, trace: bool) -> Judged:
    seed, evidence = drawn.seed, _played(drawn)
    failures = [
        Failure(seed, rule, what, decisions)
        for rule, check in RULES.items()
        for what in tuple(check(evidence))[:SHOWN_A_RULE]
    ]
    compared = _compared(drawn, evidence, decisions)
    failures += [Failure(seed, rule, what, decisions) for rule, what in compared]
    history = evidence.history
    return Judged(
        seed,
        tuple(failures),
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
    one = partial(judge, decisions=decisions)
    if jobs == 1 or len(seeds) < 2 * BATCH:
        yield from map(one, seeds)
        return
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    ignore = (signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asked
    with ProcessPoolExecutor(jobs, context, signal.signal, ignore) as pool:
        yield from pool.map(one, seeds, chunksize=BATCH)


def _played(drawn: Scenario) -> Evidence:
    memory = Path("/dev/shm")  # noqa: S108 - files in memory where there are such: power cuts are simulated
    with tempfile.TemporaryDirectory(
        prefix="sfid-", dir=memory if os.access(memory, os.W_OK) else None
    ) as root:
        return gather(Stage(drawn, Path(root)).play())


@lru_cache(LESSONS)
def _undisturbed(number: int, decisions: int) -> tuple[str, str]:
    """Return the digest of a lesson without faults, and what it is with somebody watching."""
    calm = undisturbed(lesson(number, decisions))
    return _digest(calm), _digest(calm.watched())


def _digest(drawn: Scenario) -> str:
    report = _played(drawn).report
    return report.q_sha256 if report is not None else "not finished"


def _compared(drawn: Scenario, evidence: Evidence, decisions: int) -> Iterator[tuple[str, str]]:
    """R10, and the promise that faults do not change what is learnt where everybody is waited for.

    A crowd is left out of R10: which of its workers answers before the quorum closes a round is a race of
    microseconds, which a viewer may turn as everything else does.
    """
    expected, watched = _undisturbed(lesson_of(drawn.seed), decisions)
    if watched != expected and not drawn.lesson.crowd:
        yield "R10", f"without faults {expected[:12]} is learnt, with a viewer {watched[:12]}"
    if not drawn.lesson.exact or evidence.report is None or evidence.report.q_sha256 == expected:
        return
    found = evidence.report.q_sha256
    rule = "R10" if _digest(drawn.unwatched()) == expected else "R3"
    yield rule, f"{found[:12]} is learnt, without faults and viewer {expected[:12]}"
