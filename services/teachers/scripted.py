"""A simulated teacher on the wire: an exact solver's knowledge, with errors, silence and thinking time."""

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

from protocol.keys import Keys
from protocol.messages import Decision, MistakeMark, Step
from services.client import (
    AnswerState,
    AnswerUpdate,
    Client,
    Learnt,
    Opened,
    Refused,
    TeachingError,
    Update,
    Welcomed,
)
from services.outbox import Outbox
from services.runtime.bus import Bus
from services.runtime.clock import Clock, SystemClock
from services.teachers.troubles import Hint, Troubles, no_hint
from sfid_core.sokoban.levels import LevelError, parse_levels
from sfid_core.sokoban.solver import Solution, solve
from sfid_core.sokoban.tables import TooManyStates
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.simulated import SimulatedTeacher

VIEWS_KEPT = 65_536
"""Views whose optimal actions are remembered: some 20 MB. A view is parsed once, then looked up."""
_LISTEN_S = 0.2
_DRAIN_S = 2.0


Best = Mapping[bytes, tuple[int, ...]]
"""Indexes of the optimal actions by state key."""


class ScriptedError(TeachingError):
    """The scripted teacher cannot teach this session; the message is one line, with the mend."""


@dataclass(frozen=True, slots=True)
class ScriptedConfig:
    """One scripted teacher."""

    session: str
    teacher: str = "scripted"
    seed: int = 0
    parameters: TeacherParameters = TeacherParameters()  # noqa: RUF009 - an immutable named tuple
    """Faults of the teacher; silence is sent as an abstention, so that a quorum closes."""
    delay_ms: int = 0
    """Thinking time before each answer."""
    deployment: str = "local"
    token: str | None = None
    check_key: bytes | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True)
class Said:
    """What the teacher says about a decision; an abstention when both are None."""

    decision: Decision
    action: str | None = None
    reward: float | None = None
    guidance: tuple[str, ...] = ()
    mistake: bool = False
    """The step that was seen was one; `action` is what should have been done."""


class Mind(Protocol):
    """What a teacher thinks, given the optimal actions; see SimulatedTeacher."""

    def label(self, decision: int, state: bytes, optimal: Iterable[int]) -> int | None:
        """Return the action to name in a state, None for silence."""

    def reward(self, decision: int, state: bytes, action: int, optimal: Iterable[int]) -> float | None:
        """Return what is thought of an action, None for silence."""

    def guidance(self, decision: int, state: bytes, optimal: Iterable[int]) -> tuple[int, ...]:
        """Return the actions worth considering in a state, none for silence."""

    def mark(self, decision: int, state: bytes, action: int, optimal: Iterable[int]) -> int | None:
        """Return what should have been done instead of an action, None where it was no mistake."""

    def delay_ms(self, decision: int) -> float:
        """Return the time to answer."""


def optimal_names() -> Callable[[str], tuple[str, ...]]:
    """Return a function from a view to the names of its optimal actions; it remembers levels and views.

    It raises ScriptedError where the solver cannot help.
    """
    return lru_cache(VIEWS_KEPT)(_Solver().optimal)


class Script:
    """Which answer the teacher gives to what happens, without bus and clock.

    A reward judges the action in the state before it, by the solver's optimal actions there. That state is
    the view of the decision while the action was executed, or what the step before led to; a teacher who has
    seen neither (joined in between) abstains once.

    Args: mind: makes what thinks for a number of actions, a SimulatedTeacher when None; optimal: names
    of the optimal actions of a view, to be shared by many; best: indexes of the optimal actions by state key,
    in place of `optimal` for a world whose views do not tell its states.
    """

    def __init__(
        self,
        config: ScriptedConfig,
        has_answered: Callable[[Decision], bool],
        *,
        mind: Callable[[int], Mind] | None = None,
        optimal: Callable[[str], tuple[str, ...]] | None = None,
        best: Best | None = None,
    ) -> None:
        self._best = best
        self._config = config
        self._make = mind or self._simulated
        self._mind: Mind | None = None
        self._delay_ns = config.delay_ms * 1_000_000
        self._has_answered = has_answered
        self._optimal = optimal or optimal_names()
        self._before: tuple[int, str] | None = None
        self._asked: Decision | None = None
        self.due_ns: int | None = None
        """When the teacher will have thought about the open decision; None without one to answer."""

    def hear(self, update: Update, now_ns: int) -> None:
        """Take note of what happened."""
        if isinstance(update, Learnt):
            self._remember(update.step)
        elif isinstance(update, Opened):
            self._look_at(update.decision, now_ns)

    def speak(self, now_ns: int) -> Said | None:
        """Return the answer that is due now, once. Raises ScriptedError when the solver cannot help."""
        if self._asked is None or self.due_ns is None or now_ns < self.due_ns:
            return None
        decision, self._asked, self.due_ns = self._asked, None, None
        return self._said(decision)

    def _teacher(self, decision: Decision) -> Mind:
        """Return what thinks, made for as many actions as the session has."""
        if self._mind is None:
            self._mind = self._make(len(decision.actions))
        return self._mind

    def _simulated(self, actions: int) -> Mind:
        config = self._config
        return SimulatedTeacher(config.seed, config.teacher, config.session, config.parameters, actions)

    def _remember(self, step: Step) -> None:
        if step.outcome == "running" and (self._before is None or self._before[0] <= step.decision):
            self._before = (step.decision + 1, step.next_view)

    def _look_at(self, decision: Decision, now_ns: int) -> None:
        if decision.action is None or decision.phase == "executing":
            self._before = (decision.decision, decision.view)
        if decision.phase != "asking" or self._has_answered(decision):
            self._asked = self.due_ns = None
        else:
            asked = self._asked
            thinking = asked is not None and (asked.decision, asked.asked) == (
                decision.decision,
                decision.asked,
            )
            self._asked = decision
            if not thinking:
                self.due_ns = (
                    now_ns + self._delay_ns + int(self._teacher(decision).delay_ms(decision.decision) * 1e6)
                )

    def _said(self, decision: Decision) -> Said:
        number, names, teacher = decision.decision, decision.actions, self._teacher(decision)
        if decision.asked == "label":
            label = teacher.label(number, decision.state, self._indexes(decision, decision.view))
            return Said(decision, action=None if label is None else names[label])
        if decision.asked == "guidance":
            chosen = teacher.guidance(number, decision.state, self._indexes(decision, decision.view))
            return Said(decision, guidance=tuple(names[action] for action in chosen))
        seen = self._before[1] if self._before and self._before[0] == number else None
        judges = decision.asked in {"reward", "mistake"} and (seen is not None or self._best is not None)
        if judges and decision.action in names:
            optimal = self._indexes(decision, seen or "")
            action = names.index(decision.action)
            if decision.asked == "mistake":
                better = teacher.mark(number, decision.state, action, optimal)
                return Said(decision, action=None if better is None else names[better], mistake=True)
            return Said(decision, reward=teacher.reward(number, decision.state, action, optimal))
        return Said(decision)

    def _indexes(self, decision: Decision, view: str) -> tuple[int, ...]:
        """Return the optimal actions of the decision's state, which looks like `view`."""
        if self._best is None:
            return tuple(decision.actions.index(name) for name in self._optimal(view))
        best = self._best.get(decision.state)
        if best is None or max(best, default=0) >= len(decision.actions):
            raise ScriptedError(
                f"session {decision.session!r} is in a state that the teacher's environment does not have: "
                "teach with the --gym and --gym-option that the session was created with"
            )
        return best


class _Solver:
    """Names of the optimal actions of a view; each level is solved once."""

    def __init__(self) -> None:
        self._solutions: dict[tuple[bytes, int], Solution] = {}

    def optimal(self, view: str) -> tuple[str, ...]:
        try:
            board = parse_levels(view)[0].start
            level = board.level
            key = (level.map_digest, len(level.boxes))
            if key not in self._solutions:
                self._solutions[key] = solve(level)
            return tuple(action.name for action in self._solutions[key].optimal_actions(board))
        except TooManyStates as error:
            raise ScriptedError(
                f"the level is beyond the exact solver ({error}); let people teach it or choose a smaller one"
            ) from None
        except LevelError as error:
            raise ScriptedError(
                f"the session's world is no Sokoban ({error}): name it with the --gym and --gym-option that "
                "the session was created with, or let people teach it"
            ) from None


def run(
    config: ScriptedConfig,
    bus: Bus,
    ready: Callable[[], None],
    stop: threading.Event,
    clock: Clock | None = None,
    best: Best | None = None,
    hint: Hint = no_hint,
) -> None:
    """Teach until the session is finished or `stop` is set; waits for a learner that is not there yet.

    Args: best: the optimal actions of a world that is not Sokoban, see Script; hint: see Troubles.
    Raises: ScriptedError when the level is beyond the solver or the learner does not let the teacher join.
    """
    clock = clock or SystemClock()
    # In memory: after a crash the same seed gives the same answers to the same decisions.
    client = Client(
        bus, Keys(config.deployment), config.session, config.teacher,
        outbox=Outbox(), clock=clock, token=config.token, check_key=config.check_key, measures=False,
    )  # fmt: skip
    script, troubles = (
        Script(config, client.has_answered, best=best),
        Troubles(config.session, clock, hint),
    )
    codes: Counter[AnswerState] = Counter()
    with client:
        ready()
        while not stop.is_set():
            update = client.next(_wait_s(script.due_ns, clock))
            if isinstance(update, Opened) and update.decision.phase == "finished":
                break
            if isinstance(update, Refused) and update.final:
                raise ScriptedError(f"session {config.session!r}: {update.reason} ({update.code})")
            if isinstance(update, Welcomed) and update.welcome.decision.asked in {
                "reward",
                "guidance",
                "mistake",
            }:
                client.watch_measures()  # the state before the action, should a decision message be lost
            troubles.note(update)
            if update is not None:
                script.hear(update, clock.now_ns())
            if isinstance(update, AnswerUpdate):
                codes[update.state] += 1
            if script.due_ns is not None and (said := script.speak(clock.now_ns())) is not None:
                tell(client, said)
        before, left = client.unacknowledged, client.drain(_DRAIN_S)
    saved = codes[AnswerState.SAVED] + before - left
    troubles.end(saved, codes[AnswerState.TOO_LATE], codes[AnswerState.REJECTED], left)


def _wait_s(due_ns: int | None, clock: Clock) -> float:
    return _LISTEN_S if due_ns is None else min(_LISTEN_S, max(0, due_ns - clock.now_ns()) / 1e9)


def tell(client: Client, said: Said) -> None:
    """Hand in what is said."""
    silent = said.action is None and said.reward is None and not said.guidance
    step = said.decision.step
    client.answer(
        said.decision,
        kind="abstain" if silent else None,
        action=said.action,
        reward=said.reward,
        guidance=said.guidance,
        mistake=None if silent or not said.mistake else MistakeMark(first_step=step, last_step=step),
    )
