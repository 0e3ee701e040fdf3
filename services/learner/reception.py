"""Where teachers come to: joining, answering, changing the window."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from protocol.codec import DecodeError, decode, printable
from protocol.journal import Kind, answer_body, read_answer_body, without_token
from protocol.keys import KeyNameError
from protocol.messages import Answer, Control, Done, Join, Welcome
from protocol.translate import UnknownAction, answer_given, check_posterior, episode_message, window_of
from services.runtime.front_desk import DeskSettings, FrontDesk, Refused
from services.runtime.log_config import about
from sfid_core.session.admission import NOT_OPEN_YET, why_rejected
from sfid_core.session.config import WindowMode
from sfid_core.session.effects import Acknowledge, AnswerCode, Ignored
from sfid_core.session.events import (
    AnswerGiven,
    Event,
    Paused,
    Resumed,
    Stopped,
    TeacherJoined,
    WindowChanged,
)
from sfid_core.session.machine import advance
from sfid_core.session.state import Phase

if TYPE_CHECKING:
    from services.learner.live import LiveSession
    from services.learner.service import Learner
    from services.runtime.bus import Request

log = logging.getLogger("sfid.learner")

OPERATOR = "operator"
"""The name under which the command line controls a session; nobody can teach under it."""
EPISODES_SHOWN = 50
"""Latest episodes in a welcome, for the curves of a late joiner."""


class Reception:
    """Serves the requests of teachers on the loop's thread."""

    def __init__(self, learner: Learner) -> None:
        self._learner = learner
        config = learner.config
        settings = DeskSettings("learner", config.data_dir, config.require_tokens, config.check_secrets)
        self.desk = FrontDesk(learner.loop, learner.keys, settings)

    def on_answer(self, request: Request) -> None:
        """Journal an answer, let it take effect, acknowledge it after the commit."""
        try:
            message = decode(request.payload, Answer)
            live = self._whose(request.key, message)
            self._answer(live, message, request)
        except (DecodeError, KeyNameError, UnknownAction, Refused) as error:
            self.desk.refuse(request, error)

    def _answer(self, live: LiveSession, message: Answer, request: Request) -> None:
        kept = without_token(message, request.payload)
        if self._seen_before(live, message, kept, request):
            return
        came_back = live.session.phase is Phase.FINISHED and message.teacher in live.known
        if message.teacher not in live.session.teachers and not came_back:
            raise Refused("denied", f"join session {live.name} before you answer")
        check_posterior(message)
        event = answer_given(message, live.numbers)
        if _comes_again(live, message, event):
            reason = f"decision {message.decision} comes again after a restart: send it again"
            raise Refused("busy", reason)
        learner, at_ns = self._learner, self._learner.loop.at_ns()
        learner.journal_elapsed(live)
        _, effects = advance(live.session, at_ns, event)
        told = effects[0]
        assert isinstance(told, Acknowledge)  # noqa: S101 - the machine's contract, for the type checker
        body = answer_body(told.code, told.reason, kept)
        seq = learner.append(live, Kind.ANSWER, body, at_ns, message.answer_id, message.teacher)
        if log.isEnabledFor(logging.DEBUG):
            ids = about(
                session=live.name, decision=message.decision, answer_id=message.answer_id,
                teacher=message.teacher, journal_seq=seq,
            )  # fmt: skip
            log.debug("answer journaled as %s", told.code.value, extra=ids)
        learner.perform(live, at_ns, effects[1:])
        self.desk.acknowledge(request, message, told.code, told.reason, seq)

    def _seen_before(self, live: LiveSession, message: Answer, kept: bytes, request: Request) -> bool:
        """Answer a repeat: the same content gets the same acknowledgement, another content is a conflict."""
        row = self._learner.shard.find(live.name, message.answer_id)
        if row is None:
            return False
        if row.body is None:
            raise Refused("denied", "that answer was erased at its teacher's wish")
        code, reason, before = read_answer_body(row.body)
        if before != kept and message.teacher not in live.session.teachers:
            raise Refused("denied", f"join session {live.name} before you answer")
        if before != kept:
            at_ns = self._learner.loop.at_ns()
            self._learner.append(live, Kind.CONFLICT, kept, at_ns, None, message.teacher)
            code, reason = (
                AnswerCode.CONFLICT,
                "this id came before with another content: make a new id for a new answer",
            )
        self.desk.acknowledge(request, message, code, reason, row.seq)
        return True

    def on_join(self, request: Request) -> None:
        """Let a teacher take part and tell them where the session stands."""
        try:
            message = decode(request.payload, Join)
            live = self._whose(request.key, message)
            if message.teacher == OPERATOR:
                raise Refused("denied", f"the name {OPERATOR} is kept for the command line: choose another")
            self._join(live, message, request)
        except (DecodeError, KeyNameError, Refused) as error:
            self.desk.refuse(request, error)

    def _join(self, live: LiveSession, message: Join, request: Request) -> None:
        session, learner = live.session, self._learner
        finished = session.phase is Phase.FINISHED
        if finished:  # who comes then may still hold answers
            live.known.add(message.teacher)
        elif message.teacher in session.teachers:
            self.desk.check_alone(message)
        else:
            if len(session.teachers) >= learner.config.teachers_max:
                raise Refused(
                    "busy",
                    f"session {live.name} has {learner.config.teachers_max} teachers: use an aggregator",
                )
            live.known.add(message.teacher)
            learner.happen(live, TeacherJoined(message.teacher))
            log.info(
                "session %s: teacher %s joined (%s)",
                live.name,
                message.teacher,
                printable(message.client) or "client unnamed",
            )
        if not finished:
            self.desk.has_joined(message)
            learner.expect_token(live, message.teacher)
        at_ns = learner.loop.at_ns()
        first = max(0, len(session.episodes) - EPISODES_SHOWN)
        latest = session.episodes.ended(first, EPISODES_SHOWN)
        welcome = Welcome(
            session=live.name,
            epoch=session.epoch,
            rights=() if finished else ("answer", "window", "pause"),
            decision=learner.decision(live, at_ns),
            episodes=tuple(episode_message(measures, session, ended_ns) for ended_ns, _, measures in latest),
            check_key=self.desk.check_key(message),
        )
        learner.loop.reply_durably(request, welcome)

    def on_control(self, request: Request) -> None:
        """Change the window, pause, resume or stop; journaled and durable before the reply."""
        try:
            message = decode(request.payload, Control)
            live = self._whose(request.key, message)
            if message.teacher != OPERATOR and message.teacher not in live.session.teachers:
                raise Refused("denied", f"join session {live.name} before you change it")
            if message.verb == "stop" and message.teacher != OPERATOR:
                raise Refused("denied", "only the operator stops a session: `sfid session stop`")
            effects = self._learner.happen(live, _event_of(message, live))
            ignored = next((effect.reason for effect in effects if isinstance(effect, Ignored)), "")
            self._learner.loop.reply_durably(request, Done(ok=not ignored, reason=ignored))
        except (DecodeError, KeyNameError, Refused) as error:
            self.desk.refuse(request, error)

    def _whose(self, key: str, message: Join | Answer | Control) -> LiveSession:
        """Return the session that the key names, when the body names the same session and teacher.

        Where tokens are required, the teacher also has one; the operator, whom the router's access control
        lets in, needs none.
        """
        operator = isinstance(message, Control) and message.teacher == OPERATOR
        self.desk.admit(key, message, unproved=operator)
        session = message.session
        live = self._learner.sessions.get(session)
        if live is None:
            raise Refused(
                "unknown-session", f"no session {session} here: `sfid session list` shows what there is"
            )
        return live


def _comes_again(live: LiveSession, message: Answer, event: AnswerGiven) -> bool:
    """Tell whether an answer is to a decision of the learner's former life that is to be taken again."""
    former = message.epoch < live.session.epoch and live.session.phase is not Phase.FINISHED
    return former and why_rejected(live.session, event) == NOT_OPEN_YET


def _event_of(message: Control, live: LiveSession) -> Event:
    if message.verb == "window":
        if message.window is None:
            raise Refused("invalid", "a change of the window gives the window: mode, span_ms, quorum")
        afresh = live.session.window.mode is WindowMode.UNTIL_ANSWERED
        return WindowChanged(message.teacher, window_of(message.window), afresh)
    events: dict[str, type[Paused | Resumed | Stopped]] = {
        "pause": Paused,
        "resume": Resumed,
        "stop": Stopped,
    }
    return events[message.verb](message.teacher)
