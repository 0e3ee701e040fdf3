"""Where sessions are created, listed and shown."""

from __future__ import annotations

import gc
import logging
from itertools import islice
from typing import TYPE_CHECKING

from protocol.codec import PAYLOAD_MAX, DecodeError, decode, encode
from protocol.journal import Kind
from protocol.messages import (
    Branch,
    CreateSession,
    Done,
    JournalRow,
    JournalRows,
    Refusal,
    RowsQuery,
    SessionQuery,
    SessionReport,
    SessionSummary,
)
from protocol.session_union import left_out, list_query, page
from protocol.translate import TEACHERS_NAMED_MAX, episode_message, label_totals
from services.learner.branching import branch
from services.learner.live import created
from sfid_core.learning.parameters import ParameterError
from sfid_core.session.events import Restarted

if TYPE_CHECKING:
    from collections.abc import Callable

    from services.learner.live import LiveSession
    from services.learner.service import Learner
    from services.runtime.bus import Request

log = logging.getLogger("sfid.learner")

EPISODES_A_REPORT = 100
"""About 25 KB: well within the largest payload."""
SENDERS_A_REPORT = 100
SESSIONS_A_FREEZE = 256

ROWS_A_PAGE = 256
"""Rows of the journal in one reply: some 2 ms of the loop, so that teaching goes on beside a late watcher."""
ROWS_BYTES_MAX = PAYLOAD_MAX - 4_096
ROW_BYTES = 64
"""What a row costs in a reply beside its body, at most."""


class Office:
    """Serves requests about sessions on the loop's thread; what belongs to another shard is dropped."""

    def __init__(self, learner: Learner) -> None:
        self._learner = learner
        self.verbs: dict[str, Callable[[Request], None]] = {
            "create": self._on_create,
            "branch": self._on_branch,
            "list": self._on_list,
            "show": self._on_show,
            "rows": self._on_rows,
        }

    def _on_create(self, request: Request) -> None:
        try:
            message = decode(request.payload, CreateSession)
            if not self._learner.owns(message.session):
                return
            refusal = self._create(message)
        except DecodeError as error:
            refusal = Refusal(code="malformed", reason=str(error))
        except ParameterError as error:
            refusal = Refusal(code="invalid", reason=str(error)[:512])
        if refusal is not None:
            request.reply_error(encode(refusal))
        else:
            self._learner.loop.reply_durably(request, Done(ok=True))

    def _on_branch(self, request: Request) -> None:
        try:
            message = decode(request.payload, Branch)
            if not self._learner.owns(message.session):
                return
            refusal = branch(self._learner, message)
        except DecodeError as error:
            refusal = Refusal(code="malformed", reason=str(error))
        if refusal is not None:
            request.reply_error(encode(refusal))
        else:
            self._learner.loop.reply_durably(request, Done(ok=True))

    def _create(self, message: CreateSession) -> Refusal | None:
        """Create the session, unless it is there already; return what is wrong, if anything is."""
        learner = self._learner
        present = learner.sessions.get(message.session)
        if present is not None:
            if present.config == message:
                return None
            return Refusal(
                code="conflict", reason=f"session {message.session} exists with another content: name another"
            )
        if len(learner.sessions) >= learner.config.sessions_max:
            return Refusal(
                code="busy", reason=f"this learner has {learner.config.sessions_max} sessions: start another"
            )
        live = created(message, learner.keys)
        learner.take_in(live)
        if len(learner.sessions) % SESSIONS_A_FREEZE == 0:
            gc.freeze()  # sessions stay: looking through all of them again and again would stop teaching
        at_ns = learner.loop.at_ns()
        learner.append(live, Kind.CREATED, encode(message), at_ns)
        log.info("session %s created: %s on %s", live.name, message.method, message.world.level_name)
        learner.happen(live, Restarted(learner.shard.epoch))
        return None

    def _on_list(self, request: Request) -> None:
        try:
            leave_out = list_query(request.payload).leave_out
        except DecodeError as error:
            request.reply_error(encode(Refusal(code="malformed", reason=str(error))))
            return
        shard, shards = self._learner.config.shard, self._learner.config.shards
        lives = islice(reversed(self._learner.sessions.values()), left_out(leave_out, shard, shards), None)
        self._learner.loop.reply_durably(request, page(map(_summary, lives), leave_out, shard, shards))

    def _on_show(self, request: Request) -> None:
        try:
            message = decode(request.payload, SessionQuery)
        except DecodeError as error:
            request.reply_error(encode(Refusal(code="malformed", reason=str(error))))
            return
        live = self._learner.sessions.get(message.session or "")
        if live is None:
            self._unknown(request, message.session or "")
            return
        # After the commit: whoever reads the journal next finds what the report says.
        self._learner.loop.reply_durably(request, self._report(live, message.first_episode))

    def _on_rows(self, request: Request) -> None:
        try:
            message = decode(request.payload, RowsQuery)
        except DecodeError as error:
            request.reply_error(encode(Refusal(code="malformed", reason=str(error))))
            return
        if message.session not in self._learner.sessions:
            self._unknown(request, message.session)
            return
        # After the commit, as a report: no reader is told what a crash could still take back.
        self._learner.loop.reply_durably(request, self._rows(message.session, message.after_seq))

    def _unknown(self, request: Request, session: str) -> None:
        if self._learner.owns(session):
            reason = f"no session {session} here: `sfid session list` shows what there is"
            request.reply_error(encode(Refusal(code="unknown-session", reason=reason)))

    def _rows(self, session: str, after_seq: int) -> JournalRows:
        rows: list[JournalRow] = []
        size = read = 0
        whole = True
        for row in self._learner.shard.rows(session, after_seq):
            size += ROW_BYTES + len(row.body or b"")
            # The first row goes in any case: a page without one would be asked for again for ever.
            if read and (size > ROWS_BYTES_MAX or read == ROWS_A_PAGE):
                whole = False
                break
            read, after_seq = read + 1, row.seq
            if row.body is not None:
                rows.append(JournalRow(seq=row.seq, kind=row.kind, at_ns=row.at_ns, body=row.body))
        return JournalRows(session=session, rows=tuple(rows), after_seq=after_seq, whole=whole)

    def _report(self, live: LiveSession, first: int) -> SessionReport:
        session = live.session
        shown = session.episodes.ended(first, EPISODES_A_REPORT)
        counts = self._learner.reception.desk.malformed
        malformed = {sender: count for (name, sender), count in counts.items() if name == live.name}
        return SessionReport(
            summary=_summary(live),
            config=live.config,
            epoch=session.epoch,
            labels=label_totals(session.counts),
            teaching_ns=session.teaching_ns,
            q_sha256=session.learner.sha256(),
            malformed=dict(list(malformed.items())[:SENDERS_A_REPORT]),
            failure=live.failure,
            first_episode=first,
            episodes=tuple(episode_message(measures, session, at_ns) for at_ns, _, measures in shown),
        )


def _summary(live: LiveSession) -> SessionSummary:
    session = live.session
    return SessionSummary(
        session=live.name,
        method=live.config.method,
        level_name=live.config.world.level_name,
        phase=session.phase.value,
        paused=session.paused,
        episode=session.episode,
        episodes=session.config.episodes,
        decision=session.decision,
        teachers=tuple(sorted(session.teachers)[:TEACHERS_NAMED_MAX]),
    )
