"""Everybody who is at the page, and the rooms they are in. Runs on one loop; no sockets here."""

import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from protocol.identity import Identity, Role, TokenError, TokenFault, is_revoked, verify
from protocol.keys import Keys
from services.gateway.config import Limits
from services.gateway.frames import Hello, written
from services.gateway.limits import Counters, Reason
from services.gateway.room import Post, Room
from services.gateway.visitor import GONE, LEFT_ALONE, TOO_MUCH, Line, Visitor
from services.runtime.bus import Bus
from services.runtime.clock import Clock
from services.runtime.register import Full, Register, for_session, given_for
from services.screens import Flow, Person

log = logging.getLogger("sfid.gateway")

_MS = 1_000_000
_S = 1_000_000_000
FORGET_S = 60.0
"""A person who left is remembered so long: their limits, and answers still on their way."""
FORGET_AT_LAST_S = 600.0
"""Answers that nobody acknowledged for so long are kept by the browser alone."""
CHECK_S = 1.0
"""How often tokens of those who are here are checked again."""
WHY = {
    TokenFault.MALFORMED: "this link is not whole: open it again from where you got it",
    TokenFault.FORGED: "this link is not valid here: ask for a new one",
    TokenFault.EXPIRED: "this link has expired: ask for a new one",
    TokenFault.REVOKED: "this link has been withdrawn: ask for a new one",
}


class House:
    """Admits people by token, gives them rooms, and looks after time."""

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        secrets: list[bytes],
        register: Register,
        flow: Flow,
        limits: Limits,
        clock: Clock,
        post: Post,
    ) -> None:
        self.counters = Counters()
        self.visitors: dict[tuple[str, str], Visitor] = {}
        self.rooms: dict[str, Room] = {}
        self._bus, self._keys, self._secrets, self._register = bus, keys, secrets, register
        self._flow, self._limits, self._clock, self._post = flow, limits, clock, post
        self._checked_ns = 0

    # ------------------------------------------------------------ people

    def admit(self, hello: Hello, line: Line) -> Visitor | None:
        """Return the person who says hello; None when they were refused, and told so."""
        self._register.refresh()
        try:
            identity = self.identity(hello.token)
            identity, token = self._own(identity, hello)
        except TokenError as error:
            self.counters.refuse(Reason(error.fault.value))
            self._turn_away(line, GONE, error.fault.value, WHY[error.fault])
            return None
        except Full:
            self.counters.refuse(Reason.FULL)
            self._turn_away(line, GONE, Reason.FULL.value, "this link has been used by all it was for")
            return None
        visitor = self._visitor(identity)
        if visitor is None:
            self.counters.refuse(Reason.PEOPLE)
            self._turn_away(line, TOO_MUCH, Reason.PEOPLE.value, "too many people: try again later")
            return None
        now_s = self._clock.now_ns() / _S
        if not visitor.hellos.take(now_s):
            self.counters.refuse(Reason.HELLOS)
            self._turn_away(line, TOO_MUCH, Reason.HELLOS.value, "too many connections: wait a minute")
            return None
        you = {"pseudonym": identity.pseudonym, "session": identity.session, "token": token}
        line.send(written("you", **you))
        self.counters.done["hellos"] += 1
        visitor.arrive(line, identity, token, dict(hello.arrival), now_s)
        return visitor

    def identity(self, token: str) -> Identity:
        """Return whom a token speaks of. Raises TokenError."""
        return verify(token, self._secrets, self._clock.wall_ns() / _S, self._register.revoked)

    def _own(self, identity: Identity, hello: Hello) -> tuple[Identity, str]:
        """Return the person's own identity and token: an invitation is exchanged for one."""
        if identity.role is Role.TEACHER:
            return identity, hello.token
        pseudonym = self._register.take_up(identity, hello.nonce)
        return given_for(identity, pseudonym, self._secrets)

    def _visitor(self, identity: Identity) -> Visitor | None:
        name = (identity.session, identity.pseudonym)
        visitor = self.visitors.get(name)
        if visitor is None and len(self.visitors) < self._limits.people_max:
            person = Person(identity.pseudonym, identity.session, identity.token_id, identity.invitation)
            visitor = Visitor(
                person,
                self._flow,
                self._limits,
                self.counters,
                self.room,
                partial(for_session, keys=self._secrets),
            )
            self.visitors[name] = visitor
        return visitor

    def _turn_away(self, line: Line, code: int, reason: str, text: str) -> None:
        line.send(written("refused", reason=reason, text=text, final=True))
        line.close(code, reason)

    # ------------------------------------------------------------ rooms

    def room(self, session: str) -> Room | None:
        """Return the room of a session, opened if need be; None when there are too many."""
        room = self.rooms.get(session)
        if room is None and len(self.rooms) < self._limits.rooms_max:
            room = Room(self._bus, self._keys, session, self._clock, self._post, self._settled)
            self.rooms[session] = room
        return room

    def _settled(self, state: str) -> None:
        self.counters.done[state] += 1

    # ------------------------------------------------------------ time

    def now_ns(self) -> int:
        """Return the time on the steady clock."""
        return self._clock.now_ns()

    def tick(self) -> None:
        """Do what is due; called every 50 ms or so."""
        now_ns = self._clock.now_ns()
        for room in self.rooms.values():
            room.tick(now_ns)
        for name, visitor in list(self.visitors.items()):
            if visitor.line is None and visitor.left_ns:
                self._after_leaving(name, visitor, now_ns)
        if now_ns - self._checked_ns >= CHECK_S * _S:
            self._checked_ns = now_ns
            self._check(now_ns)

    def _after_leaving(self, name: tuple[str, str], visitor: Visitor, now_ns: int) -> None:
        away_ns = now_ns - visitor.left_ns
        if away_ns >= self._limits.leave_ms * _MS:
            self._guarded(visitor, visitor.leave)
        forget_s = FORGET_S if not visitor.open_answers else FORGET_AT_LAST_S
        if away_ns >= forget_s * _S:
            visitor.forget()
            del self.visitors[name]

    def _check(self, now_ns: int) -> None:
        """Let those go whose token has expired or was revoked, and those who left the page open."""
        self._register.refresh()
        now_s = self._clock.wall_ns() / _S
        for visitor in list(self.visitors.values()):
            identity = visitor.identity
            if visitor.line is None or identity is None:
                continue
            fault = self._fault(identity, now_s)
            if fault is not None:
                self.counters.refuse(Reason(fault.value))
                visitor.end(GONE, fault.value, WHY[fault])
                continue
            self._guarded(visitor, visitor.follow)
            if now_ns / _S - visitor.heard_s > self._limits.idle_timeout_s:
                self.counters.refuse(Reason.IDLE)
                visitor.end(LEFT_ALONE, Reason.IDLE.value, "nothing was heard for hours: reload to go on")
        self._tell_of_ends()

    def _fault(self, identity: Identity, now_s: float) -> TokenFault | None:
        if is_revoked(identity, self._secrets, self._register.revoked):
            return TokenFault.REVOKED
        return TokenFault.EXPIRED if now_s >= identity.expires_s else None

    def _tell_of_ends(self) -> None:
        """Tell the flows of those who sit in a session that has finished, once each."""
        for session, room in self.rooms.items():
            decision = room.decision
            if decision is None or decision.phase != "finished":
                continue
            for visitor in list(self.visitors.values()):
                if visitor.line is not None:
                    self._guarded(visitor, partial(visitor.session_finished, session))

    def _guarded(self, visitor: Visitor, act: Callable[[], None]) -> None:
        """Call what asks a flow: its mistake with one person must not end everybody's lesson."""
        try:
            act()
        except Exception:
            self.counters.refuse(Reason.FAULT)
            log.exception("the flow failed with %s", visitor.person.pseudonym)

    # ------------------------------------------------------------ figures

    @property
    def answers_open(self) -> int:
        """How many answers the learner has not acknowledged yet."""
        return sum(visitor.open_answers for visitor in self.visitors.values())

    def facts(self) -> dict[str, Any]:
        """Return what a ServiceStatus says of a gateway."""
        return {
            "sessions": len(self.rooms),
            "running": len(self.rooms),
            "teachers": sum(visitor.line is not None for visitor in self.visitors.values()),
            "backlog": self.answers_open,
            "refused": dict(self.counters.refused),
        }

    def figures(self) -> Mapping[str, object]:
        """Return the present state in numbers; no names, no tokens."""
        return {
            "people": sum(visitor.line is not None for visitor in self.visitors.values()),
            "people_known": len(self.visitors),
            "rooms": len(self.rooms),
            "answers_open": self.answers_open,
            "unreadable": sum(room.unreadable for room in self.rooms.values()),
            "done": dict(self.counters.done),
            "refused": dict(self.counters.refused),
        }
