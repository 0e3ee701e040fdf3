"""One session as the gateway follows it: one subscription shared by all who teach it from a browser.

Everything here runs on the gateway's loop; the bus's callbacks only enqueue. Each person has a seat: their
presence, their joining and the delivery of their answers, exactly as services.client does it for one.
"""

import secrets
from collections import OrderedDict
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, cast

from protocol.codec import DecodeError, decode, encode
from protocol.keys import Keys
from protocol.messages import Answer, Decision, Episode, Join, Refusal, Step, Welcome
from services.client.delivery import Delivery, HandleReply
from services.client.updates import AnswerState, AnswerUpdate
from services.gateway.frames import (
    EPISODES_SHOWN,
    decision_frame,
    episodes_frame,
    written,
)
from services.outbox import Outbox
from services.runtime.bus import Bus, Received, Reply
from services.runtime.clock import Clock

ASK_TIMEOUT_MS = 500
JOIN_RETRY_MS = 500
SPREAD_MS = 100
"""Everybody joins again after a learner's restart; within so long, not all at once."""
SETTLED_MAX = 64
"""Answers of a person whose fate is remembered here; older ones the learner knows."""
QUIET_MS = 5000
"""A topic may lose messages in silence: after so long without one somebody joins again and hears the news."""
NOT_ACKNOWLEDGED = "no learner has taken it yet; it is kept and sent again"
_MS = 1_000_000
_chance = secrets.SystemRandom()

Post = Callable[[Callable[[Any], None], Any], None]
"""Hands a call over to the gateway's loop, from any thread."""


class Seat:
    """A person's place in a room."""

    def __init__(self, room: "Room", teacher: str, token: str, tell: Callable[[str], None]) -> None:
        self.teacher = teacher
        self.tell = tell
        self.final_refusal: str | None = None
        self._room, self._token = room, token
        self._joined = False
        self._join_due_ns: int | None = 0
        self._withdraw: Callable[[], None] | None = None
        self._open: dict[bytes, bytes] = {}
        self._settled: OrderedDict[bytes, tuple[bytes, str]] = OrderedDict()
        answer_key = room.keys.answer(room.session, teacher)
        self._delivery = Delivery(
            partial(room.ask, answer_key), self._on_update, self._on_denied, Outbox(), room.clock, _chance
        )

    @property
    def open_answers(self) -> int:
        """How many answers the learner has not acknowledged yet."""
        return len(self._open)

    def renew(self, token: str, tell: Callable[[str], None]) -> None:
        """Go on over another connection of the same person."""
        self._token, self.tell = token, tell
        self.final_refusal = None

    def sit(self) -> None:
        """Be present and join."""
        if self._withdraw is None:
            self._withdraw = self._room.bus.announce(
                self._room.keys.present(self._room.session, self.teacher)
            )
            self.join_afresh(0)

    def rise(self) -> None:
        """Be present no longer; answers on their way are still delivered."""
        if self._withdraw is not None:
            self._withdraw()
            self._withdraw = None
        self._joined, self._join_due_ns = False, None

    def answer(self, message: Answer) -> bool:
        """Deliver an answer; one on its way is not sent twice. False when it had been delivered before."""
        payload = encode(message)
        before, told = self._settled.get(message.answer_id, (b"", ""))
        if before == payload:
            self.tell(told)
            return False
        if message.answer_id not in self._open:
            self._open[message.answer_id] = payload
            self._delivery.send(message.answer_id, payload)
        return True

    def join_afresh(self, spread_ms: int) -> None:
        """Join again, soon."""
        self._joined = False
        if self._withdraw is not None:
            self._join_due_ns = self._room.clock.now_ns() + int(_chance.random() * spread_ms * _MS)

    def tick(self, now_ns: int) -> None:
        """Repeat what is due."""
        if self._join_due_ns is not None and self._join_due_ns <= now_ns:
            self.join()
        if self._open:
            self._delivery.repeat(now_ns)

    def join(self) -> None:
        """Ask to take part."""
        self._join_due_ns = None
        room = self._room
        message = Join(session=room.session, teacher=self.teacher, client="sfid page", token=self._token)
        room.ask(room.keys.join(room.session, self.teacher), encode(message), self._on_join_reply)

    def _on_join_reply(self, reply: Reply | None) -> None:
        if self._withdraw is None:
            return
        welcome = self._room.read_welcome(reply)
        if isinstance(welcome, Welcome):
            self._joined = True
            self._delivery.check_key = welcome.check_key
            self._room.on_welcome(welcome)
            self._delivery.hurry()
            return
        if isinstance(welcome, Refusal) and welcome.code in {"denied", "invalid", "malformed", "conflict"}:
            self.final_refusal = welcome.reason
            self.tell(written("refused", reason="session", text=welcome.reason, final=False))
        elif isinstance(welcome, Refusal):
            self.tell(written("link", connected=False, detail=welcome.reason))
        else:
            self.tell(written("link", connected=False, detail="waiting for the agent's computer"))
        self._join_due_ns = self._room.clock.now_ns() + int(JOIN_RETRY_MS * (0.5 + _chance.random()) * _MS)

    def _on_denied(self) -> None:
        if self._joined:
            self.join_afresh(0)

    def _on_update(self, update: AnswerUpdate) -> None:
        code = "" if update.acknowledgement is None else update.acknowledgement.code
        answer_id = update.answer_id.hex()
        frame = written("answer", id=answer_id, state=update.state.value, code=code, reason=update.reason)
        if update.state is not AnswerState.RETRYING:
            self._settled[update.answer_id] = (self._open.pop(update.answer_id), frame)
            if len(self._settled) > SETTLED_MAX:
                self._settled.popitem(last=False)
        self._room.on_answer_update(update)
        self.tell(frame)


class Room:
    """A session, its newest decision, and the seats in it."""

    def __init__(
        self, bus: Bus, keys: Keys, session: str, clock: Clock, post: Post, settled: Callable[[str], None]
    ) -> None:
        self.bus, self.keys, self.session, self.clock = bus, keys, session, clock
        self.seats: dict[str, Seat] = {}
        self.unreadable = 0
        self._post, self._settled = post, settled
        self._newest = (-1, -1)
        self._decision: tuple[Decision, int] | None = None
        self._untold = False
        self._episodes: list[Episode] = []
        self._epoch = -1
        self._heard_ns = clock.now_ns()
        for key, handle in (
            (keys.decision(session), self._on_decision),
            (keys.measures(session), self._on_measures),
        ):
            bus.subscribe(key, partial(self._receive, handle))
        self._away = False
        bus.on_connection(partial(post, self._on_connection))

    # ------------------------------------------------------------ the bus; its threads only enqueue

    def _receive(self, handle: Callable[[bytes], None], received: Received) -> None:
        self._post(handle, received.payload)

    def _on_connection(self, connected: bool) -> None:  # noqa: FBT001 - the bus calls it with one argument
        if connected and self._away:  # the learner saw all of them leave
            for seat in self.seats.values():
                seat.join_afresh(SPREAD_MS)
        self._away = not connected

    def ask(self, key: str, payload: bytes, handle: HandleReply) -> None:
        """Ask the learner; `handle` is called on the loop."""
        self.bus.ask(key, payload, partial(self._post, handle), ASK_TIMEOUT_MS)

    # ------------------------------------------------------------ what the learner says

    @property
    def decision(self) -> Decision | None:
        """The newest decision."""
        return None if self._decision is None else self._decision[0]

    def _on_decision(self, payload: bytes) -> None:
        self._heard_ns = self.clock.now_ns()
        try:
            self._take(decode(payload, Decision))
        except DecodeError:
            self.unreadable += 1

    def _take(self, decision: Decision) -> None:
        position = (decision.epoch, decision.sequence)
        if decision.session != self.session or position <= self._newest:
            return
        self._newest = position
        self._decision = (decision, self.clock.now_ns())
        # What asks, and the end, is told at once. What lies between is over in some ms as a rule: `tick`
        # tells it if it lasts, so that a crowd is not told of each moment, nor of each who joins.
        self._untold = decision.phase not in {"asking", "finished"}
        if not self._untold:
            self.tell(decision_frame(decision, 0))
        if decision.epoch > self._epoch:
            # A learner's new life does not know who was there.
            known, self._epoch = self._epoch >= 0, decision.epoch
            if known:
                for seat in self.seats.values():
                    seat.join_afresh(SPREAD_MS)

    def _on_measures(self, payload: bytes) -> None:
        self._heard_ns = self.clock.now_ns()
        try:
            message: Step | Episode = decode(payload, cast("type[Step]", Step | Episode))
        except DecodeError:
            self.unreadable += 1
            return
        if isinstance(message, Episode):
            self._keep_episodes([*self._episodes, message])

    def read_welcome(self, reply: Reply | None) -> Welcome | Refusal | None:
        """Return what the learner says to a Join; None when it says nothing that can be read."""
        if reply is None:
            return None
        try:
            return decode(reply.payload, Welcome) if reply.ok else decode(reply.payload, Refusal)
        except DecodeError:
            self.unreadable += 1
            return None

    def on_welcome(self, welcome: Welcome) -> None:
        """Take the news of a welcome."""
        self._heard_ns = self.clock.now_ns()
        if welcome.epoch < self._newest[0]:
            # Another journal: the session was created anew.
            self._newest, self._epoch = (-1, -1), -1
            self._episodes = []
        self._take(welcome.decision)
        if len(welcome.episodes) > len(self._episodes) or self._behind(welcome.episodes):
            self._keep_episodes(list(welcome.episodes))

    def _behind(self, episodes: tuple[Episode, ...]) -> bool:
        return bool(episodes and self._episodes) and episodes[-1].episode > self._episodes[-1].episode

    def _keep_episodes(self, episodes: list[Episode]) -> None:
        self._episodes = episodes[-EPISODES_SHOWN:]
        self.tell(episodes_frame(self._episodes))

    def on_answer_update(self, update: AnswerUpdate) -> None:
        """Count what became of answers."""
        self._settled(update.state.value)

    # ------------------------------------------------------------ people

    def tell(self, frame: str) -> None:
        """Tell everybody in the room."""
        for seat in self.seats.values():
            seat.tell(frame)

    def seat(self, teacher: str, token: str, tell: Callable[[str], None]) -> Seat:
        """Return the person's seat, theirs from before if they have one, and show them how things stand."""
        seat = self.seats.get(teacher)
        if seat is None:
            seat = self.seats[teacher] = Seat(self, teacher, token, tell)
        seat.renew(token, tell)
        for frame in self._news():
            tell(frame)
        seat.sit()
        return seat

    def _news(self) -> Iterable[str]:
        if self._decision is not None:
            decision, received_ns = self._decision
            yield decision_frame(decision, (self.clock.now_ns() - received_ns) // _MS)
        if self._episodes:
            yield episodes_frame(self._episodes)

    def tick(self, now_ns: int) -> None:
        """Repeat what is due, and look after a session that has gone quiet."""
        if self._untold and self._decision is not None:
            self._untold = False
            self.tell(decision_frame(self._decision[0], 0))
        for seat in list(self.seats.values()):
            seat.tick(now_ns)
        finished = self._decision is not None and self._decision[0].phase == "finished"
        if now_ns - self._heard_ns >= QUIET_MS * _MS and self.seats and not finished:
            self._heard_ns = now_ns
            next(iter(self.seats.values())).join_afresh(0)
