"""One person at the page: what they send is checked and done, what happens is told to their browser."""

import logging
from collections.abc import Callable
from typing import Protocol

from protocol.identity import Identity
from services.gateway.config import Limits
from services.gateway.frames import (
    Frame,
    Ping,
    Say,
    Submit,
    answer_of,
    checked_values,
    screen_frame,
    written,
)
from services.gateway.limits import Bucket, Counters, Reason
from services.gateway.room import Room, Seat
from services.screens import FINISHED, Flow, FlowRefusal, Person, Screen

log = logging.getLogger("sfid.gateway")

TAKEN_OVER = 4409
GONE = 4401
TOO_MUCH = 4429
BAD_FRAME = 4400
LEFT_ALONE = 4408


class Line(Protocol):
    """The connection to one browser; both calls return at once."""

    def send(self, text: str) -> None:
        """Send a frame, if the connection is open."""

    def close(self, code: int, reason: str) -> None:
        """End the connection."""


class Visitor:
    """A person, over however many connections and sessions.

    Args: room_of: finds or opens a session's room; None when there are too many.
    """

    def __init__(
        self,
        person: Person,
        flow: Flow,
        limits: Limits,
        counters: Counters,
        room_of: Callable[[str], Room | None],
        token_for: Callable[[Identity, str], str],
    ) -> None:
        self.person = person
        self.line: Line | None = None
        self.identity: Identity | None = None
        self.left_ns = 0
        self.heard_s = 0.0
        """When the person last did something; a page left open pings, and does nothing."""
        self.hellos = Bucket(limits.hellos_per_minute / 60, limits.hellos_per_minute / 3)
        self._frames = Bucket(limits.frames_per_s, limits.frames_burst)
        self._too_many = 0
        self._flow, self._limits, self._counters, self._room_of = flow, limits, counters, room_of
        self._screen: Screen | None = None
        self._seats: dict[str, tuple[Room, Seat]] = {}
        self._token_for = token_for
        self._token = ""
        self._tokens: dict[str, str] = {}
        """By session: a study's people have a token of the study, and teach sessions of their own."""
        self._told_of_end = False
        self._now_s = 0.0
        self._gone = True

    @property
    def open_answers(self) -> int:
        """How many answers are on their way."""
        return sum(seat.open_answers for _, seat in self._seats.values())

    # ------------------------------------------------------------ coming and going

    def arrive(
        self, line: Line, identity: Identity, token: str, arrival: dict[str, str], now_s: float
    ) -> None:
        """Go on over a new connection; the one before, if there still is one, is told and ended."""
        if self.line is not None:
            self.line.send(written("refused", reason="taken-over", text="", final=True))
            self.line.close(TAKEN_OVER, "taken over")
            self._counters.done["taken-over"] += 1
        self.line, self.identity, self._token = line, identity, token
        self._tokens.clear()
        self._gone = False
        self.heard_s = now_s
        self._too_many = 0
        try:
            self._flow.arrive(self.person, arrival)
        except FlowRefusal as error:
            self._refuse(Reason.FLOW, str(error), final=True)
            line.close(GONE, "not admitted")
            return
        self._show(self._flow.screen(self.person))

    def depart(self, line: Line, now_ns: int) -> None:
        """Note that a connection has ended."""
        if self.line is line:
            self.line, self.left_ns = None, now_ns

    def leave(self) -> None:
        """Be present no longer, in the session and in the flow; twice is once."""
        if not self._gone:
            self._gone = True
            self._rise()
            self._flow.depart(self.person)

    def _rise(self) -> None:
        for _, seat in self._seats.values():
            seat.rise()

    def forget(self) -> None:
        """Give up the seats."""
        for room, seat in self._seats.values():
            seat.rise()
            room.seats.pop(seat.teacher, None)
        self._seats.clear()

    def end(self, code: int, reason: str, text: str) -> None:
        """Tell the person why it is over, and end the connection."""
        if self.line is not None:
            self.line.send(written("refused", reason=reason, text=text, final=True))
            self.line.close(code, reason)

    # ------------------------------------------------------------ screens

    def _show(self, screen: Screen) -> None:
        self._screen = screen
        self._told_of_end = False
        self._tell(screen_frame(screen))
        if screen.session is None:
            self._rise()
            return
        for session, (_, seat) in self._seats.items():
            if session != screen.session:
                seat.rise()
        room = self._room_of(screen.session)
        if room is None:
            self._refuse(Reason.PEOPLE, "too many sessions at once: try again later")
            return
        self._seats[screen.session] = (
            room,
            room.seat(self.person.pseudonym, self._own_token(screen.session), self._tell),
        )

    def _own_token(self, session: str) -> str:
        if session not in self._tokens and self.identity is not None:
            own = session == self.identity.session
            self._tokens[session] = self._token if own else self._token_for(self.identity, session)
        return self._tokens.get(session, self._token)

    def session_finished(self, session: str) -> None:
        """Go on in the flow: the session that is taught here has come to its end."""
        if self._screen is not None and self._screen.session == session and not self._told_of_end:
            self._told_of_end = True
            self._submit_to_flow(self._screen, FINISHED, {})

    def follow(self) -> None:
        """Show what the flow has come to by itself."""
        if self.line is not None and self._screen is not None:
            self._follow(self._screen)

    def _follow(self, before: Screen) -> None:
        following = self._flow.screen(self.person)
        if following != before:
            self._show(following)

    def _submit(self, frame: Submit) -> None:
        screen = self._screen
        if screen is None or frame.screen != screen.name:
            # Pressed twice, or in the moment of change: show what holds now.
            self._show(self._flow.screen(self.person))
            return
        values = checked_values(screen, frame.button, frame.values)
        if values is None:
            self._refuse(Reason.FIELDS, "something is missing or does not fit: look at the marked fields")
            return
        self._submit_to_flow(screen, frame.button, values)

    def _submit_to_flow(
        self, screen: Screen, button: str, values: dict[str, bool | float | str | None]
    ) -> None:
        try:
            self._flow.submit(self.person, screen.name, button, values)
        except FlowRefusal as error:
            self._refuse(Reason.FLOW, str(error))
            return
        self._follow(screen)

    # ------------------------------------------------------------ frames

    def admit(self, now_s: float) -> bool:
        """Tell whether one more frame is within the rate; a flooder is let go."""
        self._now_s = now_s
        if self._frames.take(now_s):
            self._too_many = max(0, self._too_many - 1)
            return True
        self._too_many += 1
        self._counters.refuse(Reason.FLOOD)
        if self._too_many == self._limits.refused_max:
            self._counters.refuse(Reason.FLOODER)
            log.warning("%s sends too much: connection closed", self.person.pseudonym)
            self.end(TOO_MUCH, "flood", "too many messages: wait a minute, then reload the page")
        elif self._too_many == 1:
            self._tell(written("refused", reason="flood", text="slower, please", final=False))
        return False

    def receive(self, frame: Frame) -> None:
        """Do what a frame asks for."""
        match frame:
            case Ping():
                self._tell(written("pong"))
            case Say():
                self.heard_s = self._now_s
                self._say(frame)
            case Submit():
                self.heard_s = self._now_s
                self._submit(frame)
            case _:  # a second hello
                self._refuse(Reason.MALFORMED, "hello is said once")

    def _say(self, say: Say) -> None:
        place = self._seats.get(say.session)
        if place is None:
            self._counters.refuse(Reason.NOT_TEACHING)
            self._tell(
                written(
                    "answer", id=say.id, state="rejected", code="", reason="you do not teach this session"
                )
            )
            return
        if self.open_answers >= self._limits.answers_open_max:
            self._counters.refuse(Reason.OPEN_ANSWERS)
            self._tell(
                written("answer", id=say.id, state="retrying", code="", reason="too many on their way")
            )
            return
        self._counters.done["answers"] += 1
        if not place[1].answer(answer_of(say, self.person.pseudonym, self._own_token(say.session))):
            self._counters.refuse(Reason.REPLAY)

    def _refuse(self, reason: Reason, text: str, *, final: bool = False) -> None:
        self._counters.refuse(reason)
        self._tell(written("refused", reason=reason.value, text=text, final=final))

    def _tell(self, text: str) -> None:
        if self.line is not None:
            self.line.send(text)
