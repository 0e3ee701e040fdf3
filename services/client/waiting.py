"""What a script that teaches is told in the log while it waits for its session."""

import logging

from services.client.updates import Connection, Opened, Refused, Update, Welcomed
from services.runtime.clock import Clock

log = logging.getLogger("sfid.client")
PATIENCE_NS = 3_000_000_000
"""So long is waited in silence: a learner may be starting."""


class Waiting:
    """Logs once what is waited for, when that takes longer than PATIENCE_NS, and once that it is over.

    Args: session: to be taught; clock: only grows.
    """

    def __init__(self, session: str, clock: Clock) -> None:
        self._session, self._clock = session, clock
        self._since_ns: int | None = clock.now_ns()
        self._reason, self._told = "nothing was heard of it yet", False

    def note(self, update: Update | None) -> None:
        """Take note of what came, if anything did, and of the time."""
        match update:
            case Connection(connected=False, detail=reason) | Refused(reason=reason):
                self._reason = reason
                self._since_ns = self._clock.now_ns() if self._since_ns is None else self._since_ns
            case Welcomed() | Opened():
                if self._told:
                    log.warning("session %s: joined", self._session)
                self._since_ns, self._told = None, False
            case _:
                pass
        waited_ns = 0 if self._since_ns is None else self._clock.now_ns() - self._since_ns
        if waited_ns >= PATIENCE_NS and not self._told:
            self._told = True
            hint = "`sfid session list` shows what sessions there are"
            more = "" if hint.partition(" shows")[0] in self._reason else f" ({hint})"
            log.warning("session %s: still waiting: %s%s", self._session, self._reason, more)
