"""The learner's side of the environment: asks until it is answered, restores an environment that forgot."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, NamedTuple

from protocol.codec import DecodeError, decode, encode
from protocol.messages import Refusal, Wire
from protocol.translate import named
from protocol.world_messages import Begin, Begun, ExecuteAction, Executed
from sfid_core.outcome import Outcome
from sfid_core.session.events import EpisodeBegan, StepTaken, Stopped
from sfid_core.session.state import Phase

if TYPE_CHECKING:
    from services.learner.live import LiveSession
    from services.learner.service import Learner
    from services.runtime.bus import Reply

log = logging.getLogger("sfid.learner")

EXECUTE_TIMEOUT_MS = 500
"""A query can be lost on its way, and asking again is free: the environment executes a decision once."""
BEGIN_TIMEOUT_MS = 1_000
BEGIN_TIMEOUT_MS_MAX = 32_000
"""Solving the largest level takes about 5 s, so each further question waits twice as long as the last."""
RETRY_MS = 100


class _Answered(NamedTuple):
    """A reply of the environment, or its absence, on its way to the loop's thread."""

    live: LiveSession
    number: int
    verb: str
    reply: Reply | None


class WorldDesk:
    """Asks the environment for episodes and steps, one question at a time for each session."""

    def __init__(self, learner: Learner) -> None:
        self._learner = learner

    def begin(self, live: LiveSession) -> None:
        """Ask for the start of the session's episode."""
        live.actions_taken.clear()
        live.begin_timeout_ms = BEGIN_TIMEOUT_MS
        self._begin(live)

    def _begin(self, live: LiveSession) -> None:
        config = live.config
        message = Begin(
            session=live.name,
            epoch=live.session.epoch,
            episode=live.session.episode,
            seed=config.seed,
            world=config.world,
            actions=tuple(live.actions_taken),
        )
        self._ask(live, "begin", message, live.begin_timeout_ms)

    def execute(self, live: LiveSession) -> None:
        """Ask for the step of the session's decision."""
        session = live.session
        message = ExecuteAction(
            session=live.name,
            epoch=session.epoch,
            decision=session.decision,
            episode=session.episode,
            step=session.step,
            state=session.state,
            action=named(session.action, live.actions),
        )
        self._ask(live, "execute", message, EXECUTE_TIMEOUT_MS)

    def _ask(self, live: LiveSession, verb: str, message: Wire, timeout_ms: int) -> None:
        live.asked += 1
        number, learner = live.asked, self._learner

        def receive(reply: Reply | None) -> None:
            learner.loop.enqueue_work(self._answered, _Answered(live, number, verb, reply))

        learner.bus.ask(learner.keys.environment(verb), encode(message), receive, timeout_ms)

    def _answered(self, answered: _Answered) -> None:
        live, number, verb, reply = answered
        if number != live.asked:
            return
        if reply is None:
            self._lost(live, "does not answer")
        elif not reply.ok:
            self._refused(live, reply.payload)
        else:
            self._took(live, verb, reply.payload)

    def _took(self, live: LiveSession, verb: str, payload: bytes) -> None:
        try:
            message: Begun | Executed = (
                decode(payload, Begun) if verb == "begin" else decode(payload, Executed)
            )
        except DecodeError as error:
            self._lost(live, f"answered nonsense ({error})")
            return
        mistaken = _mistaken(live, message)
        if mistaken:
            self._lost(live, mistaken)
            return
        if live.environment_lost:
            log.warning("session %s: the environment is back: teaching goes on", live.name)
            live.environment_lost = False
        if isinstance(message, Begun):
            self._begun(live, message)
        elif live.session.phase is Phase.EXECUTING:
            live.actions_taken.append(named(live.session.action, live.actions))
            outcome = Outcome(message.outcome)
            distance = -1 if message.optimal_steps is None else message.optimal_steps
            taken = StepTaken(
                message.decision, message.reward, outcome, message.state, message.view, distance
            )
            self._learner.happen(live, taken)

    def _begun(self, live: LiveSession, begun: Begun) -> None:
        session = live.session
        if session.phase is Phase.BEGINNING:
            event = EpisodeBegan(begun.episode, begun.state, begun.view, begun.optimal_steps)
            self._learner.happen(live, event)
        elif session.phase is Phase.EXECUTING and begun.state == session.state:
            log.warning(
                "session %s: environment restored at episode %d, step %d",
                live.name,
                begun.episode,
                begun.step,
            )
            self.execute(live)
        elif session.phase is Phase.EXECUTING:
            self._give_up(
                live, "the restored environment stands in another state: its version or level differs"
            )

    def _refused(self, live: LiveSession, payload: bytes) -> None:
        try:
            refusal = decode(payload, Refusal)
        except DecodeError:
            self._lost(live, "answered an error")
            return
        if refusal.code == "unknown-session" and live.session.phase is Phase.EXECUTING:
            self._begin(live)
        elif refusal.code in ("invalid", "malformed"):
            self._give_up(live, refusal.reason)
        else:
            self._lost(live, f"refused: {refusal.reason}")

    def _lost(self, live: LiveSession, what: str) -> None:
        if not live.environment_lost:
            log.warning("session %s: the environment %s: asking again until it does", live.name, what)
            live.environment_lost = True
        self._learner.loop.call_later(RETRY_MS, self._again, live)

    def _again(self, live: LiveSession) -> None:
        if live.session.phase is Phase.EXECUTING:
            self.execute(live)
        elif live.session.phase is Phase.BEGINNING:
            live.begin_timeout_ms = min(2 * live.begin_timeout_ms, BEGIN_TIMEOUT_MS_MAX)
            self._begin(live)

    def _give_up(self, live: LiveSession, reason: str) -> None:
        if live.session.phase is Phase.FINISHED:
            return
        log.error("session %s stopped: %s", live.name, reason)
        live.failure = reason
        self._learner.happen(live, Stopped("environment"))


def _mistaken(live: LiveSession, message: Begun | Executed) -> str:
    """Say what is wrong with a well-formed reply to the latest question, or return an empty text."""
    session = live.session
    if isinstance(message, Executed):
        asked, got = session.decision, message.decision
        return "" if got == asked else f"answered for decision {got} instead of {asked}"
    if (message.episode, message.step) != (session.episode, len(live.actions_taken)):
        return f"began episode {message.episode}, step {message.step} instead of the one it was asked for"
    if message.actions != live.actions:
        return f"has the actions {', '.join(message.actions)[:200]}, not those of the session"
    return ""
