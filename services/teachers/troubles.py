"""What a simulated teacher's log says: whom it waits for, what helps, and what became of its answers."""

import logging
from collections.abc import Callable

from services.client import AnswerState, AnswerUpdate, Connection, Refused, Update, Welcomed
from services.runtime.clock import Clock

log = logging.getLogger("sfid.teacher")

PATIENCE_NS = 10_000_000_000
"""So long a session may come late: services that start side by side need some seconds."""

Hint = Callable[[], str]
"""Finds out what sessions there are, and says the mend in one line; may take some seconds."""


def no_hint() -> str:
    """Say what helps where nothing can be found out."""
    return "`sfid session list` shows what sessions there are, `sfid session create` creates one"


class Troubles:
    """Logs once that the learner is out of reach, after a time what helps, once that it is back.

    Args: session: to be taught; clock: only grows; hint: what is said after PATIENCE_NS.
    """

    def __init__(self, session: str, clock: Clock, hint: Hint = no_hint) -> None:
        self._session, self._clock, self._hint = session, clock, hint
        self._waiting: set[str] = set()
        self._since_ns: int | None = None
        self._hinted = False
        self._mends: set[str] = set()
        """Reasons with a mend of their own, as they were told while it waits."""
        self._joined = False
        self._reason = "nothing was heard of it"

    def note(self, update: Update | None, who: str = "") -> None:
        """Take note of what came to a teacher of this name, if anything did, and of the time."""
        match update:
            case Refused(code="conflict", reason=reason):
                self._wait(who, reason, has_mend=True)
            case Connection(connected=False, detail=reason) | Refused(reason=reason):
                self._wait(who, reason)
            case Welcomed():
                self._welcome(who)
            case AnswerUpdate(state=AnswerState.RETRYING, attempts=attempts, reason=reason):
                if attempts > 1 and attempts & (attempts - 1) == 0:
                    log.warning("session %s: answer sent %d times: %s", self._session, attempts, reason)
            case _:
                pass
        since_ns = None if self._reason in self._mends else self._since_ns
        if since_ns is not None and not self._hinted and self._clock.now_ns() - since_ns >= PATIENCE_NS:
            self._hinted = True
            seconds = PATIENCE_NS // 1_000_000_000
            log.warning("session %s: nothing to teach for %d s: %s", self._session, seconds, self._hint())

    def end(self, saved: int, too_late: int, rejected: int, unacknowledged: int) -> None:
        """Say what the teaching came to."""
        if not self._joined:
            log.warning("session %s: left without having joined: %s", self._session, self._reason)
            return
        counts = {"too late": too_late, "rejected": rejected, "not acknowledged": unacknowledged}
        more = "".join(f", {count} {what}" for what, count in counts.items() if count)
        log.info("session %s: %d answer%s saved%s", self._session, saved, "" if saved == 1 else "s", more)

    def _wait(self, who: str, reason: str, *, has_mend: bool = False) -> None:
        """Say why it waits: the first reason, and each that says the mend, so that no hint need be found."""
        if has_mend or not self._waiting:
            self._since_ns = self._clock.now_ns()
        if not self._waiting or (has_mend and reason not in self._mends):
            log.warning("session %s: waiting, %s", self._session, reason)
        if has_mend:
            self._mends.add(reason)
        self._waiting.add(who)
        self._reason = reason

    def _welcome(self, who: str) -> None:
        self._joined = True
        self._waiting.discard(who)
        if self._since_ns is not None and not self._waiting:
            log.info("session %s: joined", self._session)
            self._since_ns, self._hinted = None, False
            self._mends.clear()
