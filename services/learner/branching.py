"""Going back to an earlier episode: a branch of a session, begun from its rows in the journal."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from protocol.branching import Origin, branch_records, origin_body, read_origin, rows_before
from protocol.journal import Kind, Record, digest_body, fold
from protocol.messages import Branch, Refusal
from services.learner.live import recovered
from services.learner.ownership import BRANCH
from sfid_core.session.events import Paused, Restarted, TeacherLeft
from sfid_core.session.state import Phase

if TYPE_CHECKING:
    from services.learner.live import LiveSession
    from services.learner.service import Learner
    from services.runtime.journal import Row
    from sfid_core.session.state import Session

log = logging.getLogger("sfid.learner")

ROWS_MAX = 50_000
"""Rows that are copied in one group, about 15 MB and 2 s: some 25,000 steps of one teacher."""
BY = "operator"


def branch(learner: Learner, message: Branch) -> Refusal | None:
    """Begin the branch, unless it is there already; return what is wrong, if anything is."""
    parent = learner.sessions.get(message.session)
    if parent is None:
        reason = f"no session {message.session} here: `sfid session list` shows what there is"
        return Refusal(code="unknown-session", reason=reason)
    if message.branch in learner.sessions:
        if _origin_of(learner, message.branch)[::2] == (message.session, message.episode):
            return None
        return Refusal(
            code="conflict", reason=f"session {message.branch} is another one: name the branch otherwise"
        )
    if not learner.owns(message.branch):
        reason = (
            f"of several learners one has {message.session} and its branches: "
            f"begin the branch's name with {message.session}{BRANCH}"
        )
        return Refusal(code="invalid", reason=reason)
    if len(learner.sessions) >= learner.config.sessions_max:
        return Refusal(
            code="busy", reason=f"this learner has {learner.config.sessions_max} sessions: start another"
        )
    rows = [row for row in learner.shard.rows(message.session) if row.body is not None]
    records = [Record(row.kind, row.at_ns, row.body or b"") for row in rows]
    count = rows_before(records, message.episode)
    if count is None:
        return Refusal(code="invalid", reason=_not_begun(parent.session, message.episode))
    if count > ROWS_MAX:
        reason = (
            f"{count} rows stand before episode {message.episode}, {ROWS_MAX} can be copied: go back further"
        )
        return Refusal(code="invalid", reason=reason)
    copied = list(branch_records(records[:count], message.branch))
    _begin(learner, message, rows[: count + 1], copied)
    return None


def _not_begun(session: Session, episode: int) -> str:
    waits = session.phase in {Phase.GATHERING, Phase.BEGINNING, Phase.FINISHED}
    last = session.episode - waits
    said = "none has begun" if last < 0 else f"choose one from 0 to {last}"
    return f"session {session.config.session} has not begun episode {episode}: {said}"


def _begin(learner: Learner, message: Branch, rows: list[Row], copied: list[Record]) -> None:
    folded = fold(copied)
    if folded is None:
        return
    live = recovered(folded, learner.keys)
    learner.take_in(live)
    for row, record in zip(rows, copied, strict=False):
        kind, unique = Kind(record.kind), row.unique
        learner.append(live, kind, record.body, record.at_ns, unique, row.person)
    origin = Origin(message.session, rows[-1].seq, message.episode)
    at_ns = learner.loop.at_ns()
    learner.append(live, Kind.BRANCHED, origin_body(origin), at_ns)
    learner.append(live, Kind.DIGEST, digest_body(live.session, live.session.learner.sha256()), at_ns)
    log.info("session %s branches from %s before episode %d", live.name, message.session, message.episode)
    _open(learner, live)


def _open(learner: Learner, live: LiveSession) -> None:
    """Let it wait for its own teachers: those of the origin have not joined it."""
    if not live.session.paused:
        learner.happen(live, Paused(BY))
    for teacher in sorted(live.session.teachers):
        learner.happen(live, TeacherLeft(teacher))
    live.known.clear()
    learner.happen(live, Restarted(learner.shard.epoch))


def _origin_of(learner: Learner, name: str) -> Origin:
    """Return where a session comes from; an origin without a name where it is no branch."""
    for row in learner.shard.rows(name):
        if row.kind == Kind.BRANCHED.value and row.body is not None:
            return read_origin(row.body)
    return Origin("", 0, 0)
