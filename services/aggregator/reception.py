"""Where a crowd's members come to: joining and answering."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from protocol.codec import DecodeError, decode, encode, printable
from protocol.crowd_journal import CrowdKind, answered_event
from protocol.identity import check_key, check_of
from protocol.journal import answer_body, read_answer_body, without_token
from protocol.keys import KeyNameError
from protocol.messages import Acknowledgement, Answer, Control, Join, Refusal, Welcome
from protocol.translate import UnknownAction, check_posterior
from services.runtime.doorkeeper import Doorkeeper, reason_of
from sfid_core.crowd.round import Acknowledged, Crowd, MemberJoined, advance
from sfid_core.session.effects import AnswerCode

if TYPE_CHECKING:
    from services.aggregator.live import LiveCrowd
    from services.aggregator.service import Aggregator
    from services.runtime.bus import Request

log = logging.getLogger("sfid.aggregator")

NOBODY = ("-", "-")
SENDERS_MAX = 10_000
WAITING_MAX = 1_000
"""Joins that wait for the learner, a session; more are asked to come again."""


class Refused(Exception):  # noqa: N818 - not a fault of the program
    """The request cannot be served; carries the reply."""

    def __init__(self, reply: Refusal) -> None:
        super().__init__(reply.reason)
        self.reply = reply


class Reception:
    """Serves the requests of members on the loop's thread."""

    def __init__(self, aggregator: Aggregator) -> None:
        self._aggregator = aggregator
        config, wall_ns = aggregator.config, aggregator.loop.at_ns
        self.door = Doorkeeper(config.data_dir, wall_ns) if config.require_tokens else None

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
                raise Refused(Refusal(code="busy", reason="too many wait for the learner: join again"))
        except (DecodeError, KeyNameError, Refused) as error:
            self._refuse(request, error)

    def welcome(self, live: LiveCrowd, message: Join, request: Request) -> None:
        """Tell a worker where the session stands, and count them in."""
        aggregator, crowd = self._aggregator, live.crowd
        if crowd is None or live.decision is None:
            return  # the request falls, and the worker asks again
        if live.finished:  # who comes then may still hold answers
            live.known.add(message.teacher)
        elif message.teacher not in crowd.members:
            if len(crowd.members) >= aggregator.config.members_max:
                full = f"the crowd of session {live.name} has {len(crowd.members)} members: join another"
                request.reply_error(encode(Refusal(code="busy", reason=full)))
                return
            aggregator.happen(live, MemberJoined(message.teacher))
            aggregator.attendance.expect(live, message.teacher)
            log.info("session %s: %s joined the crowd (%s)", live.name, message.teacher,
                     printable(message.client) or "client unnamed")  # fmt: skip
        reply = Welcome(
            session=live.name,
            epoch=aggregator.shard.epoch,
            rights=() if live.finished else ("answer",),
            decision=aggregator.shown(live, live.decision),
            episodes=tuple(live.episodes),
            check_key=self._check_key(message),
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
            self._refuse(request, error)

    def _answer(self, live: LiveCrowd, message: Answer, kept: bytes, request: Request) -> None:
        crowd = self._member_of(live, message.teacher)
        if live.decision is None:  # after a restart: what is asked is not known yet
            raise Refused(Refusal(code="busy", reason="the crowd waits for its learner: send it again"))
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
        self._acknowledge(request, message, told.code, told.reason, seq)
        self._aggregator.perform(live, effects[1:])

    def _member_of(self, live: LiveCrowd, worker: str) -> Crowd:
        came_back = live.finished and worker in live.known
        if live.crowd is None or not (came_back or worker in live.crowd.members):
            reason = f"join session {live.name} before you answer"
            raise Refused(Refusal(code="denied", reason=reason))
        return live.crowd

    def _seen_before(self, live: LiveCrowd, message: Answer, kept: bytes, request: Request) -> bool:
        """Answer a repeat: the same content gets the same acknowledgement, another content is a conflict."""
        row = self._aggregator.shard.find(live.name, message.answer_id)
        if row is None:
            return False
        if row.body is None:
            raise Refused(Refusal(code="denied", reason="that answer was erased at its teacher's wish"))
        ours = row.kind == CrowdKind.ANSWER.value
        code, reason, before = read_answer_body(row.body) if ours else (AnswerCode.CONFLICT, "", b"")
        if before != kept:
            self._member_of(live, message.teacher)
            loop, kind = self._aggregator.loop, CrowdKind.CONFLICT.value
            loop.append(live.name, kind, kept, loop.at_ns(), None, message.teacher)
            code = AnswerCode.CONFLICT
            reason = "this id came before with another content: make a new id for a new answer"
        self._acknowledge(request, message, code, reason, row.seq)
        return True

    def _acknowledge(
        self, request: Request, message: Answer, code: AnswerCode, reason: str, seq: int
    ) -> None:
        reply = Acknowledgement(
            answer_id=message.answer_id,
            code=code.value,
            reason=reason,
            check=check_of(request.payload, self._check_key(message)),
            epoch=self._aggregator.shard.epoch,
            journal_seq=seq,
        )
        self._aggregator.loop.reply_durably(request, reply)

    def _check_key(self, message: Join | Answer) -> bytes | None:
        secrets = self._aggregator.config.check_secrets
        return check_key(message.session, message.teacher, secrets) if secrets else None

    # ------------------------------------------------------------ the rest

    def on_control(self, request: Request) -> None:
        """Refuse: one of many does not change the window of all."""
        try:
            message = decode(request.payload, Control)
            self._whose(request.key, message)
            reason = "members of a crowd do not change its session: ask whoever runs it"
            raise Refused(Refusal(code="denied", reason=reason))
        except (DecodeError, KeyNameError, Refused) as error:
            self._refuse(request, error)

    def _whose(self, key: str, message: Join | Answer | Control, *, new: bool = False) -> LiveCrowd:
        """Return the crowd that the key names, when the body names the same session and worker.

        Where tokens are required, the worker also has one.  Args: new: whether there may be a crowd from now
        on.
        """
        session, worker = message.session, message.teacher
        if self._aggregator.keys.session_and_teacher(key) != (session, worker):
            reason = "the key names another session or teacher than the message"
            raise Refused(Refusal(code="denied", reason=reason))
        fault = None if self.door is None else self.door.fault(session, worker, message.token)
        if fault is not None:
            raise Refused(Refusal(code="denied", reason=reason_of(fault)))
        aggregator = self._aggregator
        live = aggregator.crowd_of(session) if new else aggregator.crowds.get(session)
        if live is None:
            raise Refused(Refusal(code="unknown-session", reason=f"no crowd for session {session} here"))
        return live

    def _refuse(self, request: Request, error: Exception) -> None:
        """Answer with an error; unreadable messages are counted by sender and logged at 1, 2, 4, 8 ..."""
        if isinstance(error, Refused):
            request.reply_error(encode(error.reply))
            return
        unknown = isinstance(error, UnknownAction)
        reply = Refusal(code="invalid" if unknown else "malformed", reason=str(error)[:512])
        request.reply_error(encode(reply))
        malformed = self._aggregator.malformed
        sender = self._sender(request.key)
        if len(malformed) >= SENDERS_MAX and sender not in malformed:
            sender = NOBODY
        malformed[sender] += 1
        count = malformed[sender]
        if count & (count - 1) == 0:
            log.warning("session %s: unreadable message %d from %s: %s", sender[0], count, sender[1], error)

    def _sender(self, key: str) -> tuple[str, str]:
        try:
            return self._aggregator.keys.session_and_teacher(key)
        except KeyNameError:
            return NOBODY
