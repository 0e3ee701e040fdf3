"""One teacher of one session: joins, hands out what happens, carries answers and wishes to the learner."""

import secrets
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from queue import Empty, SimpleQueue
from random import Random
from types import TracebackType
from typing import Any, Literal, Self, cast

from protocol.codec import DecodeError, decode, encode
from protocol.fields import Asked
from protocol.keys import Keys, checked
from protocol.messages import (
    Answer,
    Control,
    Decision,
    Done,
    Episode,
    Join,
    MistakeMark,
    Refusal,
    Step,
    Welcome,
    WindowSpec,
)
from services.client.answered import Answered, answered_with
from services.client.checks import check_fits
from services.client.delivery import FAR_NS, Delivery, HandleReply
from services.client.presence import OwnPresence
from services.client.updates import (
    AnswerState,
    AnswerUpdate,
    Connection,
    Controlled,
    Opened,
    Refused,
    Update,
    Welcomed,
    measured,
)
from services.outbox import Outbox
from services.runtime.bus import Bus, Received, Reply
from services.runtime.clock import Clock

ASK_TIMEOUT_MS = 500
"""A learner acknowledges after one sync of its disk, some ms. What takes longer is as good as lost."""
JOIN_RETRY_MS = 500
QUIET_MS = 5000
"""A topic may lose messages in silence. After so long without one the client joins again: the Welcome says
how the session stands."""
INBOX_MAX = 4096
"""Messages that wait for `next`; a slower caller loses some, and gets the newest state by joining again."""

_FINAL, _NOBODY = frozenset({"denied", "invalid", "malformed"}), (-1, -1)
_CHANCE = secrets.SystemRandom()


class Client:
    """A context manager. `answer` and `control` may be called on any thread, `next` on one at a time.

    Args: measures: whether to hear of learnt steps and finished episodes from the start; a teacher who needs
    neither spares the router a message a step (`watch_measures` begins later).  check_key: what came with the
    token; None: believe the latest Welcome.  chance: draws ids and waits.
    """

    def __init__(  # noqa: PLR0913 - time, chance and identity are arguments
        self,
        bus: Bus,
        keys: Keys,
        session: str,
        teacher: str,
        *,
        outbox: Outbox,
        clock: Clock,
        token: str | None = None,
        check_key: bytes | None = None,
        measures: bool = True,
        chance: Random = _CHANCE,
    ) -> None:
        self.session = checked(session, "session")
        self.teacher = checked(teacher, "teacher")
        self.dropped = 0
        """Messages lost because `next` was not called for too long."""
        self._unreadable = 0
        self._bus, self._keys, self._clock, self._token = bus, keys, clock, token
        self._check_key, self._chance, self.due_ns = check_key, chance, 0
        """`due_ns`: when `next` has something to repeat."""
        answer_key = keys.answer(self.session, self.teacher)
        self._delivery = Delivery(
            partial(self._ask, answer_key), self._on_answer_update, self._on_denied, outbox, clock, chance
        )
        self._inbox: SimpleQueue[tuple[Callable[[Any], None], Any]] = SimpleQueue()
        self._updates: deque[Update] = deque()
        self._newest = _NOBODY
        self._current: Opened | None = None
        self._shown = (_NOBODY, 0)
        self._answered: Answered | None = None
        self._epoch: int | None = None
        self._connected: bool | None = None
        self._join_due_ns: int | None = None
        self._join_attempts = self._heard_ns = 0
        self._missed = self._closed = self._denied = False
        self._presence = OwnPresence(bus, partial(keys.present, self.session, self.teacher), chance)
        self._wants_measures, self._watches_measures = measures, False

    def __enter__(self) -> Self:
        bus, keys = self._bus, self._keys
        self._delivery.load(self.session, self.teacher)
        bus.subscribe(keys.decision(self.session), partial(self._receive, self._on_decision))
        if self._wants_measures:
            self.watch_measures()
        self._presence.show()
        bus.on_connection(lambda connected: self._inbox.put((self._on_connection, connected)))
        self._ask_to_join()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the session and end a waiting `next`; twice is once.

        Answers that are not acknowledged stay in the outbox, and the bus stays open.
        """
        if not self._closed:
            self._closed = True
            self._presence.end()
            self._inbox.put((lambda _: None, None))  # wakes a waiting `next`

    def watch_measures(self) -> None:
        """Hear of learnt steps and finished episodes from now on; twice is once."""
        if not self._watches_measures:
            self._watches_measures = True
            self._bus.subscribe(self._keys.measures(self.session), partial(self._receive, self._on_measures))

    @property
    def unacknowledged(self) -> int:
        """How many answers the learner has not acknowledged yet."""
        return len(self._delivery)

    @property
    def unreadable(self) -> int:
        """How many messages and replies were not what the protocol says."""
        return self._unreadable + self._delivery.unreadable

    def next(self, timeout_s: float) -> Update | None:
        """Return what happened next; None after close(), or when nothing did for `timeout_s` (0: no wait)."""
        deadline_ns = self._clock.now_ns() + int(timeout_s * 1e9)
        while not self._updates and not self._closed:
            now_ns = self._clock.now_ns()
            self.due_ns = due_ns = self._repeat(now_ns)
            wait_s = max(0, min(due_ns, deadline_ns) - now_ns) / 1e9
            try:
                handle, argument = self._inbox.get(timeout=wait_s) if wait_s else self._inbox.get_nowait()
            except Empty:
                if deadline_ns <= due_ns and not self._updates:
                    return None
            else:
                handle(argument)
        return self._updates.popleft() if not self._closed else None

    def answer(
        self,
        decision: Decision,
        *,
        kind: Asked | Literal["abstain"] | None = None,
        action: str | None = None,
        reward: float | None = None,
        guidance: tuple[str, ...] = (),
        mistake: MistakeMark | None = None,
        posterior: Mapping[str, float] | None = None,
        at_ns: int | None = None,
    ) -> bytes:
        """Store an answer, send it until it is acknowledged, and return its id at once.

        Args: kind: what is said; None is what the decision asks for.  action: a label, one of
        `decision.actions`; with a mistake, what should have been done.  reward: in [-1, 1].  at_ns: when it
        was given, now when None.
        Raises: ValueError when the answer does not fit the decision, OutboxError when it cannot be kept.
        """
        kind = kind or decision.asked
        message = Answer(
            answer_id=self._chance.randbytes(16),
            session=self.session,
            teacher=self.teacher,
            epoch=decision.epoch,
            decision=decision.decision,
            episode=decision.episode,
            step=decision.step,
            state=decision.state,
            kind=kind,
            action=decision.action if kind == "reward" else action,
            reward=reward,
            guidance=guidance,
            mistake=mistake,
            posterior=None if posterior is None else dict(posterior),
            response_ms=self._response_ms(decision, self._clock.now_ns() if at_ns is None else at_ns),
            token=self._token,
        )
        check_fits(message, decision.actions)
        return self.send(message)

    def send(self, message: Answer) -> bytes:
        """Store an answer that the caller made and keeps, send it until it is acknowledged; return its id."""
        self._answered = answered_with(message, self._current.decision if self._current else None)
        # In this order: a bus in the same thread may bring the acknowledgement before `send` returns.
        self._inbox.put((self._updates.append, AnswerUpdate(message.answer_id, AnswerState.SENDING)))
        self._delivery.send(message.answer_id, encode(message))
        return message.answer_id

    def has_answered(self, decision: Decision) -> bool:
        """Tell whether the last answer was to this window and has not been rejected, whatever the epoch."""
        return self._answered is not None and self._answered.was_to(decision)

    def control(
        self, verb: Literal["window", "pause", "resume", "stop"], window: WindowSpec | None = None
    ) -> None:
        """Ask the learner to change the window, pause, resume or stop; a Controlled tells what came of it."""
        message = Control(
            session=self.session, teacher=self.teacher, verb=verb, window=window, token=self._token
        )
        key = self._keys.control(self.session, self.teacher)
        self._ask(key, encode(message), partial(self._on_control_reply, verb))

    def drain(self, timeout_s: float) -> int:
        """Wait until every answer is acknowledged, `timeout_s` at most; returns how many are not.

        Every other update of that time is dropped.
        """
        deadline_ns = self._clock.now_ns() + int(timeout_s * 1e9)
        while self.unacknowledged and (left_ns := deadline_ns - self._clock.now_ns()) > 0:
            self.next(left_ns / 1e9)
        return self.unacknowledged

    # ---------------------------------------------------------------- on threads of the bus: only enqueue

    def _receive(self, handle: Callable[[Any], None], received: Received) -> None:
        if self._inbox.qsize() < INBOX_MAX:
            self._inbox.put((handle, (received.payload, self._clock.now_ns())))
        elif not self._closed:
            self.dropped += 1
            self._missed = True

    def _ask(self, key: str, payload: bytes, handle: HandleReply) -> None:
        # Replies are not bounded by INBOX_MAX: there is one for each open request, and none may be lost.
        self._bus.ask(key, payload, lambda reply: self._inbox.put((handle, reply)), ASK_TIMEOUT_MS)

    def _on_decision(self, received: tuple[bytes, int]) -> None:
        payload, self._heard_ns = received
        try:
            self._take(decode(payload, Decision), self._heard_ns)
        except DecodeError:
            self._unreadable += 1

    def _take(self, decision: Decision, received_ns: int) -> None:
        position = (decision.epoch, decision.sequence)
        if position <= self._newest or self._presence.hidden:
            return
        self._newest = position
        self._current = Opened(decision, received_ns)
        self._updates.append(self._current)
        number = (decision.epoch, decision.decision)
        if decision.phase == "asking" and number != self._shown[0]:
            self._shown = (number, self._clock.now_ns())
        if self._epoch is not None and decision.epoch > self._epoch:
            self._epoch = None
            self._ask_to_join()

    def _response_ms(self, decision: Decision, at_ns: int) -> int | None:
        number, shown_ns = self._shown
        if number != (decision.epoch, decision.decision):
            return None
        return max(0, at_ns - shown_ns) // 1_000_000

    def _on_measures(self, received: tuple[bytes, int]) -> None:
        payload, self._heard_ns = received
        try:
            message = decode(payload, cast("type[Step]", Step | Episode))
        except DecodeError:
            self._unreadable += 1
        else:
            self._updates.append(measured(message))

    def _on_connection(self, connected: bool) -> None:  # noqa: FBT001 - the bus calls it with one argument
        before, self._connected = self._connected, connected
        if connected == before:
            return
        detail = "connected to the router" if connected else "the router is gone, trying to reach it again"
        self._updates.append(Connection(connected, detail))
        if connected and before is False:
            self._ask_to_join()

    def _on_denied(self) -> None:
        if self._epoch is not None:
            self._epoch = None
            # Not at once again: a learner that goes on denying would be asked in a circle.
            (self._join_soon if self._denied else self._ask_to_join)()
            self._denied = True

    def _ask_to_join(self) -> None:
        self._join_due_ns = None
        self._join_attempts += 1
        self._heard_ns = self._clock.now_ns()
        program = self._presence.program
        message = Join(session=self.session, teacher=self.teacher, client=program, token=self._token)
        self._ask(self._keys.join(self.session, self.teacher), encode(message), self._on_join_reply)

    def _on_join_reply(self, reply: Reply | None) -> None:
        if reply is None:
            asked = f"asked {self._join_attempts} times" if self._join_attempts > 1 else "asked once"
            detail = f"no learner answers for session {self.session!r} yet ({asked}); start it or wait"
            self._cannot_join(detail)
            return
        try:
            if reply.ok:
                self._on_welcome(decode(reply.payload, Welcome))
            else:
                self._on_refusal(decode(reply.payload, Refusal))
        except DecodeError as error:
            self._unreadable += 1
            self._cannot_join(f"the learner's reply could not be read ({error}); use one version of both")

    def _cannot_join(self, detail: str) -> None:
        self._updates.append(Connection(connected=False, detail=detail))
        self._join_soon()

    def _on_refusal(self, refusal: Refusal) -> None:
        final = refusal.code in _FINAL
        self._updates.append(Refused(refusal.code, refusal.reason, final))
        if refusal.code == "conflict":  # somebody else is there under the name
            self._presence.hide()
            self._delivery.hold()
        if not final:
            self._join_soon()

    def _join_soon(self) -> None:
        wait_ns = int(JOIN_RETRY_MS * (0.5 + self._chance.random()) * 1_000_000)
        self._join_due_ns = self._clock.now_ns() + wait_ns

    def _on_welcome(self, welcome: Welcome) -> None:
        if self._check_key not in {None, welcome.check_key}:
            self._unreadable += 1
            self._cannot_join("who answers has not the key that came with the token: it is not your learner")
            return
        self._join_attempts = 0
        self._presence.show()
        self._delivery.check_key = welcome.check_key
        if welcome.epoch < self._newest[0]:
            # Another journal: the session was created anew, and what was seen before is of another world.
            self._newest, self._shown, self._answered = _NOBODY, (_NOBODY, 0), None
        self._epoch = welcome.epoch
        self._updates.append(Welcomed(welcome))
        self._take(welcome.decision, self._clock.now_ns())
        self._delivery.hurry()

    # ---------------------------------------------------------------- answers, wishes, repetitions

    def _on_answer_update(self, update: AnswerUpdate) -> None:
        self._updates.append(update)
        self._denied = self._denied and update.state is AnswerState.RETRYING
        rejected = update.state is AnswerState.REJECTED
        if rejected and self._answered and update.answer_id == self._answered.answer_id:
            answered, self._answered = self._answered, None
            current = self._current
            reopened = current and current.decision.decision == answered.decision
            if current and reopened and current.decision.epoch > answered.epoch:
                # Given to the learner's former life and not known in this one: the decision is open again.
                self._updates.append(current)

    def _on_control_reply(self, verb: str, reply: Reply | None) -> None:
        if reply is None:
            self._updates.append(Controlled(verb, ok=False, reason="the learner did not answer, try again"))
            return
        try:
            done = decode(reply.payload, Done) if reply.ok else decode(reply.payload, Refusal)
        except DecodeError:
            self._unreadable += 1
            self._updates.append(Controlled(verb, ok=False, reason="the learner's reply could not be read"))
        else:
            self._updates.append(Controlled(verb, isinstance(done, Done) and done.ok, done.reason))

    def _repeat(self, now_ns: int) -> int:
        """Repeat what is due and return when something will be due next."""
        finished = self._current is not None and self._current.decision.phase == "finished"
        if self._missed and self._inbox.empty():
            self._missed = False
            self._ask_to_join()
        if self._join_due_ns is None and not finished and now_ns - self._heard_ns >= QUIET_MS * 1_000_000:
            self._join_due_ns = now_ns
        if self._join_due_ns is not None and self._join_due_ns <= now_ns:
            self._ask_to_join()
        due_ns = self._join_due_ns
        if due_ns is None:
            due_ns = FAR_NS if finished else self._heard_ns + QUIET_MS * 1_000_000
        return min(due_ns, self._delivery.repeat(now_ns))
