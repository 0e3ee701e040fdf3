"""A loop over decisions, for scripts of a few lines."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from protocol.keys import Keys
from protocol.messages import Decision
from services.client.client import Client
from services.client.updates import Opened, Refused
from services.client.waiting import Waiting
from services.outbox import Outbox
from services.runtime.access import access_for
from services.runtime.clock import Clock, SystemClock
from services.runtime.zenoh_bus import open_bus
from services.topology import teaching_role

CONNECT_MS = 5000
DRAIN_S = 2.0


class TeachingError(Exception):
    """The learner does not let the teacher join; the message is one line."""


class Teaching:
    """The decisions of a session one after another, and the answers to them.

    Args: clock: only grows; by it a long waiting is told in the log.
    """

    def __init__(self, client: Client, clock: Clock | None = None) -> None:
        self.client = client
        self._clock = clock or SystemClock()

    def decisions(self) -> Iterator[Decision]:
        """Yield each decision that asks for an answer once, and end when the session is finished.

        Raises TeachingError when the teacher may not join; waits for a learner, or a session, that is not
        there yet, and after some seconds logs what it waits for (logger `sfid.client`).
        """
        waiting = Waiting(self.client.session, self._clock)
        last: tuple[int, int, str] | None = None
        while True:
            update = self.client.next(1.0)
            waiting.note(update)
            if isinstance(update, Refused) and update.final:
                raise TeachingError(f"session {self.client.session!r}: {update.reason} ({update.code})")
            if not isinstance(update, Opened):
                continue
            decision = update.decision
            if decision.phase == "finished":
                return
            number = (decision.epoch, decision.decision, decision.asked)
            if decision.phase == "asking" and number != last and not self.client.has_answered(decision):
                last = number
                yield decision

    def answer(
        self,
        decision: Decision,
        *,
        action: str | None = None,
        reward: float | None = None,
        guidance: tuple[str, ...] = (),
    ) -> bytes:
        """Say which action you would take, praise or blame, or which actions are worth considering.

        With none of them you say that you have nothing to say.
        """
        if action is None and reward is None and not guidance:
            return self.client.answer(decision, kind="abstain")
        return self.client.answer(decision, action=action, reward=reward, guidance=guidance)


@contextmanager
def join(  # noqa: PLR0913 - most have a default
    endpoint: str,
    session: str,
    teacher: str,
    *,
    token: str | None = None,
    check_key: bytes | None = None,
    outbox: str | Path | None = None,
    deployment: str = "local",
    connect_ms: int = CONNECT_MS,
    access: str | Path | None = None,
) -> Iterator[Teaching]:
    """Teach a session over the router at `endpoint`; the end waits up to 2 s for the last acknowledgements.

    Args: outbox: a file that keeps answers until they are acknowledged, in memory when None; connect_ms: how
    long to try for a router; access: directory of the login; None: where a router on this machine has told.
    Raises: BusError when no router answers, SecretError for a missing login, KeyNameError for a bad name,
    OutboxError.
    """
    with Outbox(None if outbox is None else Path(outbox)) as kept:
        folder = None if access is None else Path(access)
        login = access_for(endpoint, teaching_role(deployment).value, folder)
        bus = open_bus(endpoint, connect_ms, access=login)
        try:
            with Client(
                bus,
                Keys(deployment),
                session,
                teacher,
                outbox=kept,
                clock=SystemClock(),
                token=token,
                check_key=check_key,
            ) as client:
                yield Teaching(client)
                client.drain(DRAIN_S)
        finally:
            bus.close()
