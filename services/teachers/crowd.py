"""A simulated crowd: many workers in one process and one thread, each a member of its own."""

import heapq
import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from queue import Empty, SimpleQueue

from protocol.keys import Keys
from protocol.messages import Decision
from services.client import (
    AnswerState,
    AnswerUpdate,
    Client,
    Opened,
    Refused,
    TeachingError,
    Welcomed,
)
from services.client.one_loop import LoopBus
from services.outbox import Outbox
from services.runtime.bus import Bus
from services.runtime.clock import Clock, SystemClock
from services.teachers.scripted import Best, Script, ScriptedConfig, optimal_names, tell
from services.teachers.troubles import Hint, Troubles, no_hint
from sfid_core.chance import stream, unit
from sfid_core.learning.parameters import ParameterError
from sfid_core.teaching.crowd_mix import WorkerKind, WorkerSpec, mind_of

_TICK_NS = 100_000_000
"""How often those whom nothing comes to are asked whether they have something to repeat."""
_DRAIN_NS = 2_000_000_000


class CrowdError(TeachingError):
    """The crowd cannot teach this session; the message is one line."""


@dataclass(frozen=True, slots=True)
class CrowdConfig:
    """A simulated crowd of one session. Raises: ParameterError."""

    session: str
    workers: tuple[WorkerSpec, ...]
    seed: int = 0
    delay_ms: int = 0
    """Mean thinking time; each worker has one of their own, drawn between half and one and a half of it."""
    dropout_rate: float = 0.0
    """Probability in [0, 1] that a worker leaves at a decision, unanswered."""
    away_ms: int = 0
    """How long one who left stays away; 0 is for good."""
    deployment: str = "local-crowd"

    def __post_init__(self) -> None:
        if self.delay_ms < 0 or self.away_ms < 0:
            raise ParameterError("delay_ms and away_ms are 0 or more")
        if not 0 <= self.dropout_rate <= 1:
            raise ParameterError(f"dropout_rate {self.dropout_rate} is outside [0, 1]: 0 is never")


@dataclass(frozen=True, slots=True)
class WorkerResult:
    """What became of a worker's answers."""

    worker: str
    kind: WorkerKind
    accepted: int
    too_late: int
    rejected: int
    unacknowledged: int
    left: int
    """How often the worker left."""


@dataclass(slots=True)
class _Worker:
    """One worker: a client on the common bus, and what they think."""

    spec: WorkerSpec
    client: Client
    script: Script
    line: LoopBus
    outbox: Outbox
    leaves: int
    """Names the draws of leaving."""
    finished: bool = False
    away_until_ns: int | None = None
    """Not there: until then, or, when negative, for good."""
    decision: int = -1
    """The last decision at which staying or leaving was drawn."""
    due_ns: int | None = None
    codes: Counter[AnswerState] = field(default_factory=Counter)
    left: int = 0


class SimulatedCrowd:
    """All workers of a process; `turn` runs what is due on the caller's thread."""

    def __init__(
        self, config: CrowdConfig, bus: Bus, clock: Clock, hint: Hint = no_hint, best: Best | None = None
    ) -> None:
        self._config, self._bus, self._clock, self._best = config, bus, clock, best
        self.troubles = Troubles(config.session, clock, hint)
        self._keys = Keys(config.deployment)
        self._woken: SimpleQueue[int] = SimpleQueue()
        self._due: list[tuple[int, int]] = []
        """(when, worker) of answers and returns; stale ones are skipped."""
        self._tick_ns = 0
        self._optimal = optimal_names()
        self._workers = [self._made(number, spec) for number, spec in enumerate(config.workers)]

    def open(self) -> None:
        """Let everybody join."""
        for worker in self._workers:
            worker.client.__enter__()

    @property
    def finished(self) -> bool:
        """Whether nobody has anything left to do."""
        return all(worker.finished for worker in self._workers)

    @property
    def unacknowledged(self) -> int:
        """How many answers are not acknowledged yet."""
        return sum(worker.client.unacknowledged for worker in self._workers)

    def turn(self, timeout_s: float) -> None:
        """Take what has come, answer what is due; waits `timeout_s` at most when there is nothing."""
        now_ns = self._clock.now_ns()
        next_ns = min(self._tick_ns, self._due[0][0] if self._due else self._tick_ns)
        wait_s = min(timeout_s, max(0, next_ns - now_ns) / 1e9)
        for number in self._who_was_woken(wait_s):
            self._listen(number)
        if self._clock.now_ns() >= self._tick_ns:
            self._tick_ns = self._clock.now_ns() + _TICK_NS
            for number in range(len(self._workers)):
                self._listen(number)
        while self._due and self._due[0][0] <= self._clock.now_ns():
            self._serve(heapq.heappop(self._due)[1])

    def results(self) -> tuple[WorkerResult, ...]:
        """Return what became of everybody's answers."""
        return tuple(
            WorkerResult(
                worker.spec.name,
                worker.spec.kind,
                worker.codes[AnswerState.SAVED],
                worker.codes[AnswerState.TOO_LATE],
                worker.codes[AnswerState.REJECTED],
                worker.client.unacknowledged,
                worker.left,
            )
            for worker in self._workers
        )

    def close(self) -> None:
        """Let everybody leave."""
        for worker in self._workers:
            worker.client.close()

    def _made(self, number: int, spec: WorkerSpec) -> _Worker:
        line, outbox = LoopBus(self._bus, partial(self._woken.put, number)), Outbox()
        client = self._client(spec, line, outbox)
        leaves = stream(self._config.seed, "crowd-dropout", spec.name, self._config.session)
        return _Worker(spec, client, self._script(spec, client), line, outbox, leaves)

    def _client(self, spec: WorkerSpec, line: LoopBus, outbox: Outbox) -> Client:
        return Client(
            line, self._keys, self._config.session, spec.name,
            outbox=outbox, clock=self._clock, measures=False,
        )  # fmt: skip

    def _script(self, spec: WorkerSpec, client: Client) -> Script:
        config = self._config
        own = 0.5 + unit(stream(config.seed, "crowd-delay", spec.name), 0)
        scripted = ScriptedConfig(
            config.session, spec.name, config.seed, delay_ms=int(config.delay_ms * own),
            deployment=config.deployment,
        )  # fmt: skip
        mind = partial(mind_of, spec, config.seed, config.session)
        return Script(scripted, client.has_answered, mind=mind, optimal=self._optimal, best=self._best)

    def _who_was_woken(self, wait_s: float) -> set[int]:
        woken: set[int] = set()
        try:
            woken.add(self._woken.get(timeout=wait_s) if wait_s else self._woken.get_nowait())
            for _ in range(16 * len(self._workers)):
                woken.add(self._woken.get_nowait())
        except Empty:
            pass
        return woken

    def _listen(self, number: int) -> None:
        worker = self._workers[number]
        while not worker.away_until_ns and (update := worker.client.next(0)) is not None:
            self.troubles.note(update, worker.spec.name)
            match update:
                case Refused(code=code, reason=reason, final=True):
                    raise CrowdError(f"session {self._config.session!r}: {reason} ({code})")
                case Welcomed(welcome) if welcome.decision.asked != "label":
                    worker.client.watch_measures()
                case AnswerUpdate(state=state):
                    worker.codes[state] += 1
                case Opened(decision):
                    worker.finished = decision.phase == "finished"
                    if self._leaves(worker, decision):
                        self._go(number)
                        return
            worker.script.hear(update, self._clock.now_ns())
        if worker.script.due_ns is not None and worker.script.due_ns != worker.due_ns:
            heapq.heappush(self._due, (worker.script.due_ns, number))
        worker.due_ns = worker.script.due_ns

    def _leaves(self, worker: _Worker, decision: Decision) -> bool:
        if decision.phase != "asking" or decision.decision <= worker.decision:
            return False
        worker.decision = decision.decision
        return unit(worker.leaves, decision.decision) < self._config.dropout_rate

    def _go(self, number: int) -> None:
        """Leave as somebody does who closes the window: answers on their way are kept."""
        worker, away_ms = self._workers[number], self._config.away_ms
        worker.left += 1
        worker.client.close()
        worker.line.release()
        if away_ms:
            worker.away_until_ns = self._clock.now_ns() + away_ms * 1_000_000
            heapq.heappush(self._due, (worker.away_until_ns, number))
        else:
            worker.away_until_ns, worker.finished = -1, True

    def _serve(self, number: int) -> None:
        worker, now_ns = self._workers[number], self._clock.now_ns()
        if worker.away_until_ns is not None:
            if 0 < worker.away_until_ns <= now_ns:
                self._return(worker)
            return
        said = worker.script.speak(now_ns)
        if said is not None:
            tell(worker.client, said)

    def _return(self, worker: _Worker) -> None:
        worker.away_until_ns = None
        worker.client = self._client(worker.spec, worker.line, worker.outbox)
        worker.script = self._script(worker.spec, worker.client)
        worker.client.__enter__()


def run(
    config: CrowdConfig,
    bus: Bus,
    ready: Callable[[], None],
    stop: threading.Event,
    clock: Clock | None = None,
    hint: Hint = no_hint,
    best: Best | None = None,
) -> tuple[WorkerResult, ...]:
    """Teach until the session is finished, everybody has left for good, or `stop` is set.

    Args: hint: see Troubles; best: the optimal actions of a world that is not Sokoban, see Script.
    Returns: what became of the answers, by worker.
    Raises: ScriptedError when the level is beyond the solver or the world is another one, CrowdError when a
    worker may not join.
    """
    clock = clock or SystemClock()
    crowd = SimulatedCrowd(config, bus, clock, hint, best)
    crowd.open()
    ready()
    while not stop.is_set() and not crowd.finished:
        crowd.turn(0.2)
        crowd.troubles.note(None)
    until_ns = clock.now_ns() + _DRAIN_NS
    while crowd.unacknowledged and clock.now_ns() < until_ns:
        crowd.turn(0.05)
    crowd.close()
    results = crowd.results()
    sums = (sum(one[place] for one in map(_counts, results)) for place in range(4))
    crowd.troubles.end(*sums)
    return results


def _counts(one: WorkerResult) -> tuple[int, int, int, int]:
    return one.accepted, one.too_late, one.rejected, one.unacknowledged
