"""What a session's rows say without somebody: the bodies to be read in place of the erased ones.

A person becomes somebody without a name who abstains where their answer counted. So whoever waited for it
still went on at the same moment, the steps that were taken stay (what the table would have chosen instead
never happened), others' answers stay, and the table is what they alone would have taught.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from protocol.branching import origin_body, read_origin
from protocol.codec import decode, encode
from protocol.journal import (
    Kind,
    Record,
    answer_body,
    digest_body,
    event_body,
    events_of,
    read_answer_body,
    read_step_body,
    step_body,
)
from protocol.messages import Answer, CreateSession
from protocol.translate import action_names, config_of
from sfid_core.learning.kernels import keep_step
from sfid_core.session.effects import AnswerCode
from sfid_core.session.events import (
    Event,
    Paused,
    Resumed,
    Stopped,
    TeacherJoined,
    TeacherLeft,
    WindowChanged,
    WindowElapsed,
)
from sfid_core.session.machine import advance
from sfid_core.session.state import Session, new_session

Rows = Iterable[tuple[int, Record]]
Corrections = Mapping[bytes, Answer | None]
"""By answer id: what a crowd would have handed on; None: nothing."""


@dataclass(slots=True)
class Forgotten:
    """What is to be erased of a session, and what it comes to then."""

    amendments: dict[int, bytes | None] = field(default_factory=dict)
    """By row: what is read there from now on; None: nothing."""
    answers: int = 0
    """Answers of the person among the rows."""
    corrected: int = 0
    """Answers of crowds that come out otherwise."""
    followed: int = 0
    """Steps that the table would now choose otherwise."""
    q_sha256_before: str = ""
    q_sha256: str = ""


def forget_in_session(
    rows: Iterable[tuple[int, Record]], person: str, corrections: Corrections
) -> Forgotten | None:
    """Return what is to be erased of a person in one session, None when the rows are no session of a learner.

    Args: rows: (number, record) of the session, in order, erased ones left out.
    Raises: DecodeError when a body cannot be read.
    """
    known = list(rows)
    if not known or known[0][1].kind != Kind.CREATED.value:
        return None
    message = decode(known[0][1].body, CreateSession)
    forgetting = _Forgetting(message, person, corrections, _nameless(known))
    forgetting.find_undos(record for _, record in known[1:])
    for seq, record in known[1:]:
        forgetting.take(seq, record)
    found = forgetting.found
    found.q_sha256_before = forgetting.was.learner.sha256()
    found.q_sha256 = forgetting.now.learner.sha256()
    return found


def is_alone_in(session: str, rows: Rows, person: str) -> bool:
    """Tell whether a session is named after the person and nobody else answered in it: a lesson of theirs."""
    if f"-{person}-" not in f"-{session}-":
        return False
    spoken = {Kind.ANSWER.value, Kind.CONFLICT.value}
    return all(_who(record) == person for _, record in rows if record.kind in spoken)


def _nameless(rows: list[tuple[int, Record]]) -> str:
    """Return a name that nobody in the session has."""
    names = {name for _, record in rows if (name := _who(record)) is not None}
    return next(name for number in range(1, len(rows) + 2) if (name := f"erased-{number}") not in names)


def _who(record: Record) -> str | None:
    """Return whom a row speaks of, None for the rows of the session itself."""
    if record.kind == Kind.ANSWER.value:
        return decode(read_answer_body(record.body)[2], Answer).teacher
    if record.kind == Kind.CONFLICT.value:
        return decode(record.body, Answer).teacher
    if record.kind not in _BY_SOMEBODY:
        return None
    for _, event in events_of(record, {}):
        match event:
            case TeacherJoined(name) | TeacherLeft(name) | Paused(name) | Resumed(name) | Stopped(name):
                return name
            case WindowChanged(name):
                return name
    return None


_BY_SOMEBODY = {
    kind.value for kind in (Kind.JOINED, Kind.LEFT, Kind.WINDOW, Kind.PAUSED, Kind.RESUMED, Kind.STOPPED)
}


class _Forgetting:
    """Two sessions side by side: as it was, and as it is without the person."""

    def __init__(self, message: CreateSession, person: str, corrections: Corrections, nameless: str) -> None:
        actions = action_names(message.world)
        self._numbers = {name: index for index, name in enumerate(actions)}
        self._person, self._corrections, self._nameless = person, corrections, nameless
        self.was: Session = new_session(config_of(message), len(actions))
        self.now: Session = new_session(config_of(message), len(actions))
        self.found = Forgotten()
        self._may_undo = True
        self._undos: set[int] = set()

    def find_undos(self, records: Iterable[Record]) -> None:
        """Learn which decisions took a step back."""
        session = new_session(self.was.config, len(self._numbers))
        for record in records:
            self._advance(session, record)
            if session.undo_due:
                self._undos.add(session.decision)
        self._may_undo = session.learner.method.undo is not keep_step

    def take(self, seq: int, record: Record) -> None:
        """Let both sessions go on by a row, and note what is read there from now on."""
        body = self._step(record) if record.kind == Kind.STEP.value else self._instead(record)
        if record.kind != Kind.STEP.value:
            self._advance(self.was, record)
            if body is not None:
                self._advance(self.now, record._replace(body=body))
        if body != record.body:
            self.found.amendments[seq] = body

    def _advance(self, session: Session, record: Record) -> None:
        for at_ns, event in events_of(record, self._numbers):
            advance(session, at_ns, event)

    def _step(self, record: Record) -> bytes:
        taken, elapsed_at_ns = read_step_body(record.body)
        if elapsed_at_ns is not None:
            advance(self.was, elapsed_at_ns, WindowElapsed())
            advance(self.now, elapsed_at_ns, WindowElapsed())
        action = self.was.action if taken.action < 0 else taken.action
        advance(self.was, record.at_ns, taken)
        same = self.now.action == action and self.now.undo_due is (action == len(self._numbers))
        # Teachers decide afterwards whether it is taken back: said with it, so that it is as it was.
        undone = int(taken.decision + 1 in self._undos) if self._may_undo and self.found.amendments else -1
        if same and undone in {-1, taken.undone}:
            advance(self.now, record.at_ns, taken)
            return record.body
        followed = replace(taken, action=taken.action if same else action, undone=undone)
        advance(self.now, record.at_ns, followed)
        self.found.followed += not same
        return step_body(followed, elapsed_at_ns)

    def _instead(self, record: Record) -> bytes | None:
        if record.kind == Kind.ANSWER.value:
            return self._answer(record.body)
        if record.kind == Kind.DIGEST.value:
            before = digest_body(self.was, self.was.learner.sha256())
            now = digest_body(self.now, self.now.learner.sha256())
            return record.body if before == now else now
        if record.kind == Kind.BRANCHED.value:
            return self._origin(record.body)
        if _who(record) != self._person:
            return record.body
        if record.kind == Kind.CONFLICT.value:
            return None
        return self._without_name(record)

    def _origin(self, body: bytes) -> bytes:
        """Return where a branch is from, without a name that speaks of the person."""
        origin = read_origin(body)
        speaks = f"-{self._person}-" in f"-{origin.session}-"
        return origin_body(origin._replace(session=self._nameless)) if speaks else body

    def _without_name(self, record: Record) -> bytes:
        ((_, event),) = events_of(record, self._numbers)
        name = self._nameless
        another: Event = (
            replace(event, by=name) if isinstance(event, WindowChanged) else type(event)(name)  # type: ignore[call-arg, arg-type]
        )
        return event_body(another)[1]

    def _answer(self, body: bytes) -> bytes | None:
        code, reason, payload = read_answer_body(body)
        message = decode(payload, Answer)
        if message.teacher == self._person:
            self.found.answers += 1
            return self._abstention(code, message, self._nameless)
        if message.answer_id not in self._corrections:
            return body
        instead = self._corrections[message.answer_id]
        said = (
            self._abstention(code, message, message.teacher)
            if instead is None
            else answer_body(code, reason, encode(instead))
        )
        self.found.corrected += said != body
        return said

    def _abstention(self, code: AnswerCode, message: Answer, name: str) -> bytes | None:
        """Return the answer without its content; None where it came to nothing anyway."""
        if code is not AnswerCode.ACCEPTED:
            return None
        nothing = Answer(
            answer_id=message.answer_id, session=message.session, teacher=name, epoch=message.epoch,
            decision=message.decision, episode=message.episode, step=message.step, state=message.state,
            kind="abstain",
        )  # fmt: skip
        return answer_body(code, "", encode(nothing))
