"""What a simulated crowd is made of: kinds of workers, and how each of them thinks."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from sfid_core.chance import below, stream, unit
from sfid_core.learning.parameters import ParameterError
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.simulated import SimulatedTeacher

WORKERS_MAX = 10_000
_PART = re.compile(r"(?P<kind>[a-z]+)(@(?P<accuracy>[0-9.]+))?:(?P<count>[0-9]{1,5})")


class WorkerKind(StrEnum):
    """How a worker thinks; every one of them sees the optimal actions that the solver knows."""

    EXPERT = "expert"
    """Always names an optimal action."""
    GOOD = "good"
    """Right with probability 0.8, unless another is given; an error names another action."""
    CARELESS = "careless"
    """Right with probability 0.6, unless another is given."""
    RANDOM = "random"
    """Names any action, whatever the state."""
    CONSTANT = "constant"
    """Names one action, always the same."""
    ADVERSARY = "adversary"
    """Never names an optimal action."""


ACCURACIES = {
    WorkerKind.EXPERT: 1.0,
    WorkerKind.GOOD: 0.8,
    WorkerKind.CARELESS: 0.6,
    WorkerKind.ADVERSARY: 0.0,
}


@dataclass(frozen=True, slots=True)
class WorkerSpec:
    """One simulated worker."""

    name: str
    kind: WorkerKind
    accuracy: float
    """Probability that a label is right; unused by who does not look."""


def parse_mix(text: str, prefix: str = "w") -> tuple[WorkerSpec, ...]:
    """Return the workers of a mix such as `good:12,random:5,adversary:3` or `good@0.9:2,random:3`.

    Raises: ParameterError with the mend.
    """
    workers: list[WorkerSpec] = []
    for part in text.split(","):
        found = _PART.fullmatch(part.strip())
        if found is None or found["kind"] not in set(WorkerKind):
            kinds = ", ".join(WorkerKind)
            message = f"mix {part.strip()!r} is not KIND:COUNT or KIND@ACCURACY:COUNT: kinds are {kinds}"
            raise ParameterError(message)
        kind = WorkerKind(found["kind"])
        accuracy = _accuracy(kind, found["accuracy"])
        first = sum(worker.kind is kind for worker in workers)
        count = int(found["count"])
        workers += [WorkerSpec(f"{prefix}-{kind}-{first + n}", kind, accuracy) for n in range(1, count + 1)]
    if not 1 <= len(workers) <= WORKERS_MAX:
        message = f"mix {text!r} has {len(workers)} workers: 1 to {WORKERS_MAX} are possible"
        raise ParameterError(message)
    return tuple(workers)


def _accuracy(kind: WorkerKind, given: str | None) -> float:
    if given is None:
        return ACCURACIES.get(kind, 0.0)
    try:
        accuracy = float(given)
    except ValueError:
        accuracy = -1.0
    if kind not in ACCURACIES or not 0 <= accuracy <= 1:
        message = (
            f"mix {kind}@{given}: an accuracy is a number from 0 to 1, and only of who looks at the state"
        )
        raise ParameterError(message)
    return accuracy


class Looking:
    """Sees what is optimal and errs at a rate."""

    def __init__(self, spec: WorkerSpec, seed: int, session: str, actions: int = 4) -> None:
        error = 1.0 - spec.accuracy
        parameters = TeacherParameters(label_error=error, reward_error=error)
        self._teacher = SimulatedTeacher(seed, spec.name, session, parameters, actions)

    def label(self, decision: int, state: bytes, optimal: Iterable[int]) -> int | None:
        """See Mind."""
        return self._teacher.label(decision, state, optimal)

    def reward(self, decision: int, state: bytes, action: int, optimal: Iterable[int]) -> float | None:
        """See Mind."""
        return self._teacher.reward(decision, state, action, optimal)

    def guidance(self, decision: int, state: bytes, optimal: Iterable[int]) -> tuple[int, ...]:
        """See Mind."""
        return self._teacher.guidance(decision, state, optimal)

    def mark(self, decision: int, state: bytes, action: int, optimal: Iterable[int]) -> int | None:
        """See Mind."""
        return self._teacher.mark(decision, state, action, optimal)

    def delay_ms(self, _decision: int) -> float:
        """See Mind; a worker's delay is the mix's own."""
        return 0.0


class Blind:
    """Names any action, or one and the same, whatever is optimal."""

    def __init__(self, spec: WorkerSpec, seed: int, session: str, actions: int = 4) -> None:
        self._key = stream(seed, "crowd", spec.name, session)
        self._actions = actions
        self._constant = below(self._key, 0, actions) if spec.kind is WorkerKind.CONSTANT else None

    def label(self, decision: int, _state: bytes, _optimal: Iterable[int]) -> int | None:
        """See Mind."""
        return below(self._key, decision, self._actions) if self._constant is None else self._constant

    def reward(self, decision: int, _state: bytes, _action: int, _optimal: Iterable[int]) -> float | None:
        """See Mind."""
        praise = unit(self._key, decision) < 0.5 if self._constant is None else self._constant % 2 == 0
        return 1.0 if praise else -1.0

    def guidance(self, decision: int, state: bytes, optimal: Iterable[int]) -> tuple[int, ...]:
        """See Mind."""
        label = self.label(decision, state, optimal)
        return () if label is None else (label,)

    def mark(self, decision: int, state: bytes, action: int, optimal: Iterable[int]) -> int | None:
        """See Mind."""
        label = self.label(decision, state, optimal)
        return None if label == action else label

    def delay_ms(self, _decision: int) -> float:
        """See Mind; a worker's delay is the mix's own."""
        return 0.0


def mind_of(spec: WorkerSpec, seed: int, session: str, actions: int = 4) -> Looking | Blind:
    """Return how a worker thinks; every draw is named by (seed, worker, session) and the decision.

    Args: actions: number of actions; Sokoban has four.
    """
    return (Looking if spec.kind in ACCURACIES else Blind)(spec, seed, session, actions)
