"""Where a crowd's members come to: joining and answering."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from protocol.codec import DecodeError, decode, printable
from protocol.crowd_journal import CrowdKind, answered_event
from protocol.journal import answer_body, read_answer_body, without_token
from protocol.keys import KeyNameError
from protocol.messages import Answer, Control, Decision, Join, Welcome
from protocol.translate import UnknownAction, check_posterior
from services.runtime.front_desk import DeskSettings, FrontDesk, Refused
from sfid_core.crowd.round import Acknowledged, Crowd, MemberJoined, advance
from sfid_core.session.effects import AnswerCode

if TYPE_CHECKING:
    from services.aggregator.live import LiveCrowd
    from services.aggregator.service import Aggregator
    from services.runtime.bus import Request

log = logging.getLogger("sfid.aggregator")

WAITING_MAX = 1_000
"""Joins that wait for the learner, a session; more are asked to come again."""


class Reception:
    """Serves the requests of members on the loop's thread."""

    def __init__(self, aggregator: Aggregator) -> None:
        self._aggregator = aggregator
        config = aggregator.config
        settings = DeskSettings("aggregator", config.data_dir, config.require_tokens, config.check_secrets)
        self.desk = FrontDesk(aggregator.loop, aggregator.keys, settings)

    # ------------------------------------------------------------ joining

    def on_join(self, request: Request) -> None:
        """Let a worker take part, as soon as the learner lets the crowd."""
        try:
            message = decode(request.payload, Join)
            live = self._whose(request.key, message, new=True)
            if live.crowd is not None and live.decision is not None:
                self.welcome(live, message, request)
            elif len(live.waiting) < WAITING_MAX or message.teacher in live.waiting:
                live.waiting[message.teacher] = (message, request)
                live.leaving = False
                live.upstream.enter(live.handed)
            else:
                raise Refused("busy", "too many wait for the learner: join again")
        except (DecodeError, KeyNameError, Refused) as error:
            self.desk.refuse(request, error)

    def welcome(self, live: LiveCrowd, message: Join, request: Request) -> None:
        """Tell a worker where the session stands, and count them in; or why not."""
        try:
            if live.crowd is not None and live.decision is not None:
                self._welcome(live, live.crowd, live.decision, message, request)
            # Else the request falls, and the worker asks again.
        except Refused as error:
            self.desk.refuse(request, error)

    def _welcome(
        self, live: LiveCrowd, crowd: Crowd, decision: Decision, message: Join, request: Request
    ) -> None:
        aggregator = self._aggregator
        if live.finished:  # who comes then may still hold answers
            live.known.add(message.teacher)
        elif message.teacher in crowd.members:
            self.desk.check_alone(message)
        else:
            if len(crowd.members) >= aggregator.config.members_max:
                full = f"the crowd of session {live.name} has {len(crowd.members)} members: join another"
                raise Refused("busy", full)
            aggregator.happen(live, MemberJoined(message.teacher))
            log.info("session %s: %s joined the crowd (%s)", live.name, message.teacher,
                     printable(message.client) or "client unnamed")  # fmt: skip
        if not live.finished:
            self.desk.has_joined(message)
            aggregator.attendance.expect(live, message.teacher)
        reply = Welcome(
            session=live.name,
            epoch=aggregator.shard.epoch,
            rights=() if live.finished else ("answer",),
            decision=aggregator.shown(live, decision),
            episodes=tuple(live.episodes),
            check_key=self.desk.check_key(message),
        )
        aggregator.loop.reply_durably(request, reply)

    # ------------------------------------------------------------ answering

    def on_answer(self, request: Request) -> None:
        """Journal an answer, let it take effect, acknowledge it after the commit."""
        try:
            message = decode(request.payload, Answer)
            live = self._whose(request.key, message)
            kept = without_token(message, request.payload)
            if not self._seen_before(live, message, kept, request):
                self._answer(live, message, kept, request)
        except (DecodeError, KeyNameError, UnknownAction, Refused) as error:
            self.desk.refuse(request, error)

    def _answer(self, live: LiveCrowd, message: Answer, kept: bytes, request: Request) -> None:
        crowd = self._member_of(live, message.teacher)
        if live.decision is None:  # after a restart: what is asked is not known yet
            raise Refused("busy", "the crowd waits for its learner: send it again")
        check_posterior(message)
        event = answered_event(message, live.numbers)
        loop = self._aggregator.loop
        at_ns = loop.at_ns()
        effects = advance(crowd, at_ns, event)
        told = effects[0]
        assert isinstance(told, Acknowledged)  # noqa: S101 - the machine's contract, for the type checker
        body = answer_body(told.code, told.reason, kept)
        kind = CrowdKind.ANSWER.value
        seq = loop.append(live.name, kind, body, at_ns, message.answer_id, message.teacher)
        self.desk.acknowledge(request, message, told.code, told.reason, seq)
        self._aggregator.perform(live, effects[1:])

    def _member_of(self, live: LiveCrowd, worker: str) -> Crowd:
        came_back = live.finished and worker in live.known
        if live.crowd is None or not (came_back or worker in live.crowd.members):
            reason = f"join session {live.name} before you answer"
            raise Refused("denied", reason)
        return live.crowd

    def _seen_before(self, live: LiveCrowd, message: Answer, kept: bytes, request: Request) -> bool:
        """Answer a repeat: the same content gets the same acknowledgement, another content is a conflict."""
        row = self._aggregator.shard.find(live.name, message.answer_id)
        if row is None:
            return False
        if row.body is None:
            raise Refused("denied", "that answer was erased at its teacher's wish")
        ours = row.kind == CrowdKind.ANSWER.value
        code, reason, before = read_answer_body(row.body) if ours else (AnswerCode.CONFLICT, "", b"")
        if before != kept:
            self._member_of(live, message.teacher)
            loop, kind = self._aggregator.loop, CrowdKind.CONFLICT.value
            loop.append(live.name, kind, kept, loop.at_ns(), None, message.teacher)
            code = AnswerCode.CONFLICT
            reason = "this id came before with another content: make a new id for a new answer"
        self.desk.acknowledge(request, message, code, reason, row.seq)
        return True

    # ------------------------------------------------------------ the rest

    def on_control(self, request: Request) -> None:
        """Refuse: one of many does not change the window of all."""
        try:
            message = decode(request.payload, Control)
            self._whose(request.key, message)
            reason = "members of a crowd do not change its session: ask whoever runs it"
            raise Refused("denied", reason)
        except (DecodeError, KeyNameError, Refused) as error:
            self.desk.refuse(request, error)

    def _whose(self, key: str, message: Join | Answer | Control, *, new: bool = False) -> LiveCrowd:
        """Return the crowd that the key names, when the body names the same session and worker.

        Where tokens are required, the worker also has one.  Args: new: whether there may be a crowd from now
        on.
        """
        self.desk.admit(key, message)
        aggregator = self._aggregator
        session = message.session
        live = aggregator.crowd_of(session) if new else aggregator.crowds.get(session)
        if live is None:
            raise Refused("unknown-session", f"no crowd for session {session} here")
        return live
