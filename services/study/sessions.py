"""Sessions of participants: created and stopped on a thread of their own, so that no page waits."""

import logging
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass

from protocol.messages import CreateSession, World
from protocol.translate import window_spec
from services.operator import Operator, OperatorError
from sfid_core.study.assignment import world_seed
from sfid_core.study.definition import Study
from sfid_core.study.flow import Progress

log = logging.getLogger("sfid.study")
CREATE_TRIES = 1000
STOP_TRIES = 5
AGAIN_S = 1.0
"""How long after a refusal it is tried again: a learner may be restarting, or its disk be full."""


def session_config(study: Study, progress: Progress, pseudonym: str, period: int) -> CreateSession:
    """Return the session that a person teaches in a period, 0 for practice; equal arguments, equal session.

    Practice is with the method that comes first for them.
    """
    lesson = study.lesson(period)
    condition = study.conditions[progress.order[max(0, period - 1)]]
    return CreateSession(
        session=study.session(pseudonym, period),
        world=World(level=lesson.level, level_name=lesson.level_name, starts=lesson.starts),
        method=condition.method,
        parameters=dict(condition.parameters),
        episodes=lesson.episodes,
        seed=world_seed(study, progress.number or 0, period),
        window=window_spec(lesson.window),
        teachers_min=1,
    )


@dataclass(slots=True)
class _Wish:
    session: str
    ask: Callable[[], None]
    tries_left: int


class Sessions:
    """Has sessions created and stopped by an operator; what is refused is asked for again, a while."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._wishes: queue.SimpleQueue[_Wish | None] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._created: set[str] = set()
        self._thread = threading.Thread(target=self._work, name="study-sessions", daemon=True)
        self._thread.start()

    def create(self, config: CreateSession) -> None:
        """Have a session created, soon; the same again is the same session."""
        if config.session not in self._created:
            self._created.add(config.session)
            self._wishes.put(_Wish(config.session, lambda: self._operator.create(config), CREATE_TRIES))

    def stop(self, session: str) -> None:
        """Have a session stopped, if it was begun in the life of this process."""
        if session in self._created:
            self._created.discard(session)
            self._wishes.put(_Wish(session, lambda: self._operator.control(session, "stop"), STOP_TRIES))

    def hold(self, session: str, *, on: bool) -> None:
        """Have a session paused, or go on again; one that does so already is left as it is."""
        if session in self._created:
            verb = "pause" if on else "resume"
            self._wishes.put(_Wish(session, lambda: self._operator.control(session, verb), STOP_TRIES))

    def close(self) -> None:
        """End the thread; what was not done yet is not done."""
        self._closing.set()
        self._wishes.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (wish := self._wishes.get()) is not None and not self._closing.is_set():
            try:
                wish.ask()
            except OperatorError as error:
                if str(error).startswith(f"session {wish.session}: "):
                    continue  # paused, going on or finished already
                log.warning("session %s: %s", wish.session, error)
                wish.tries_left -= 1
                if wish.tries_left:
                    self._closing.wait(AGAIN_S)
                    self._wishes.put(wish)
