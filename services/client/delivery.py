"""Answers on their way: stored before the first sending, sent again until acknowledged, then forgotten."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from random import Random

from protocol.codec import DecodeError, decode
from protocol.identity import check_of
from protocol.messages import Acknowledgement, Answer, Refusal
from services.client.updates import AnswerState, AnswerUpdate
from services.outbox import Outbox
from services.runtime.bus import Reply
from services.runtime.clock import Clock
from services.runtime.log_config import about

log = logging.getLogger("sfid.client")

BACKOFF_MS_MIN, BACKOFF_MS_MAX = 100, 2000
"""The wait before a repetition is drawn between 0 and a bound that doubles from the first to the second."""
FAR_NS = 2**63
"""Later than anything that a steady clock will ever say."""

_RETRIED = frozenset({"busy", "not-durable", "unknown-session", "denied"})
_STATES = {
    "accepted": AnswerState.SAVED,
    "superseded": AnswerState.TOO_LATE,
    "late": AnswerState.TOO_LATE,
    "rejected": AnswerState.REJECTED,
    "conflict": AnswerState.REJECTED,
}

HandleReply = Callable[[Reply | None], None]


@dataclass(slots=True)
class _Sending:
    """One answer; `due_ns` is when to send it again, None while a request is open."""

    answer_id: bytes
    payload: bytes
    due_ns: int | None = None
    attempts: int = 0


class Delivery:
    """Carries the answers of one teacher. `send` may run on any thread, the rest on that of `Client.next`."""

    def __init__(
        self,
        ask: Callable[[bytes, HandleReply], None],
        tell: Callable[[AnswerUpdate], None],
        denied: Callable[[], None],
        outbox: Outbox,
        clock: Clock,
        chance: Random,
    ) -> None:
        self.unreadable = 0
        self.check_key: bytes | None = None
        """What the Welcome said that checks are keyed with."""
        self._ask, self._tell, self._denied = ask, tell, denied
        self._outbox, self._clock, self._chance = outbox, clock, chance
        self._sending: dict[bytes, _Sending] = {}
        self._held = False

    def __len__(self) -> int:
        return len(self._sending)

    def load(self, session: str, teacher: str) -> None:
        """Take up the answers of an earlier run of this teacher; `hurry` sends them."""
        for answer_id, payload in self._outbox.pending():
            try:
                answer = decode(payload, Answer)
            except DecodeError:
                self.unreadable += 1
                continue
            if (answer.session, answer.teacher) == (session, teacher):
                self._sending[answer_id] = _Sending(answer_id, payload, FAR_NS)

    def send(self, answer_id: bytes, payload: bytes) -> None:
        """Keep an answer and send it. Raises OutboxError when it cannot be kept: then it is not sent."""
        self._outbox.store(answer_id, payload)
        if log.isEnabledFor(logging.DEBUG):
            log.debug("answer stored, sending it", extra=_about(payload))
        held = self._held
        self._sending[answer_id] = sending = _Sending(answer_id, payload, 0 if held else None)
        if not held:
            self._send(sending)

    def hold(self) -> None:
        """Send nothing until `hurry`: whoever is sent away is not heard, and what they say is kept."""
        self._held = True

    def hurry(self) -> None:
        """Send now whatever waits: the learner is there, and lets this teacher in."""
        self._held = False
        for sending in list(self._sending.values()):
            if sending.due_ns is not None:
                self._send(sending)

    def repeat(self, now_ns: int) -> int:
        """Send again what is due and return when something will be due next."""
        due_ns = FAR_NS
        if not self._sending or self._held:
            return due_ns
        for sending in list(self._sending.values()):  # one C call, so `send` on another thread does no harm
            if sending.due_ns is None:
                continue
            if sending.due_ns <= now_ns:
                self._send(sending)
            else:
                due_ns = min(due_ns, sending.due_ns)
        return due_ns

    def _send(self, sending: _Sending) -> None:
        sending.due_ns = None
        sending.attempts += 1
        self._ask(sending.payload, partial(self._on_reply, sending))

    def _on_reply(self, sending: _Sending, reply: Reply | None) -> None:
        if reply is None:
            self._retry(sending, "no acknowledgement")
            return
        try:
            if reply.ok:
                self._on_acknowledgement(sending, decode(reply.payload, Acknowledgement))
            else:
                self._on_refusal(sending, decode(reply.payload, Refusal))
        except DecodeError:
            self.unreadable += 1
            self._retry(sending, "the learner's reply could not be read")

    def _on_acknowledgement(self, sending: _Sending, acknowledgement: Acknowledgement) -> None:
        check = check_of(sending.payload, self.check_key)
        if acknowledgement.check != check or acknowledgement.answer_id != sending.answer_id:
            self._retry(sending, "the acknowledgement is of something else")
        else:
            state = _STATES[acknowledgement.code]
            self._settle(sending, state, acknowledgement.reason, acknowledgement)

    def _on_refusal(self, sending: _Sending, refusal: Refusal) -> None:
        if refusal.code not in _RETRIED:
            self._settle(sending, AnswerState.REJECTED, refusal.reason)
            return
        self._retry(sending, refusal.reason)
        if refusal.code == "denied":
            self._denied()

    def _settle(
        self,
        sending: _Sending,
        state: AnswerState,
        reason: str,
        acknowledgement: Acknowledgement | None = None,
    ) -> None:
        del self._sending[sending.answer_id]
        if log.isEnabledFor(logging.DEBUG):
            log.debug(
                "answer %s after %d tries", state.value, sending.attempts, extra=_about(sending.payload)
            )
        self._tell(AnswerUpdate(sending.answer_id, state, acknowledgement, sending.attempts, reason))
        self._outbox.delete(
            sending.answer_id
        )  # last: should it fail, the teacher still knows the answer's fate

    def _retry(self, sending: _Sending, reason: str) -> None:
        bound_ms = min(BACKOFF_MS_MAX, BACKOFF_MS_MIN << min(sending.attempts - 1, 10))
        sending.due_ns = self._clock.now_ns() + int(self._chance.random() * bound_ms * 1_000_000)
        self._tell(AnswerUpdate(sending.answer_id, AnswerState.RETRYING, None, sending.attempts, reason))


def _about(payload: bytes) -> dict[str, dict[str, str | int]]:
    """Return the ids of an answer for a line of the log."""
    answer = decode(payload, Answer)
    return about(
        session=answer.session, decision=answer.decision, answer_id=answer.answer_id, teacher=answer.teacher
    )
