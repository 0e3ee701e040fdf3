"""The journal's records: events of a session as bodies of rows, and rows as a session again.

An answer's body is what its teacher was told and the message as they sent it, without the identity token.
A closing by the clock is folded into the step that it led to (`elapsed_at_ns`), unless something else
happened in between.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated, NamedTuple, TypeVar

import msgspec

from protocol.codec import DecodeError, DecodeFault, decode, encode, pack, printable, read
from protocol.fields import Count, Finite, Name, Nanoseconds, StateKey, Text, View
from protocol.messages import Answer, CreateSession
from protocol.translate import UnknownAction, action_names, answer_given, config_of, named
from sfid_core.outcome import Outcome
from sfid_core.session.config import Window, WindowMode
from sfid_core.session.effects import Acknowledge, AnswerCode, Effect
from sfid_core.session.events import (
    EpisodeBegan,
    Event,
    Paused,
    Restarted,
    Resumed,
    StepTaken,
    Stopped,
    TeacherJoined,
    TeacherLeft,
    WindowChanged,
    WindowElapsed,
)
from sfid_core.session.machine import advance
from sfid_core.session.state import Session, new_session

T = TypeVar("T")


class Kind(Enum):
    """Kinds of rows."""

    CREATED = "created"
    JOINED = "joined"
    LEFT = "left"
    BEGAN = "began"
    ANSWER = "answer"
    ELAPSED = "elapsed"
    STEP = "step"
    WINDOW = "window"
    PAUSED = "paused"
    RESUMED = "resumed"
    STOPPED = "stopped"
    RESTARTED = "restarted"
    DIGEST = "digest"
    """No event: the SHA-256 of the table at this point, for `replay --verify`."""
    BRANCHED = "branched"
    """No event: the rows before it are a copy of another session's; see `protocol.branching`."""
    CONFLICT = "conflict"
    """No event: an answer that came under the id of another; kept for audit, never applied."""


Distance = Annotated[int, msgspec.Meta(ge=-1)]


# Two rows come with every step: a class is found among the readers sooner than a type of a tuple.
class _AnswerRow(msgspec.Struct, array_like=True, forbid_unknown_fields=True, gc=False):
    code: str
    reason: Text
    answer: bytes


class _StepRow(msgspec.Struct, array_like=True, forbid_unknown_fields=True, gc=False):
    decision: Count
    reward: Finite
    outcome: str
    state: StateKey
    view: View
    elapsed_at_ns: Nanoseconds | None
    distance: Distance


class _FollowedStepRow(_StepRow, array_like=True, forbid_unknown_fields=True, gc=False):
    action: Distance
    undone: Distance


class _WindowRow(msgspec.Struct, array_like=True, forbid_unknown_fields=True):
    by: Name
    mode: str
    span_ms: int
    quorum: int
    afresh: bool = False


_CODES = {code.value: code for code in AnswerCode}
_OUTCOMES = {outcome.value: outcome for outcome in Outcome}


class Record(NamedTuple):
    """What the fold needs of a journal row."""

    kind: str
    at_ns: int
    body: bytes


def without_token(message: Answer, payload: bytes) -> bytes:
    """Return an answer's payload as it is journaled and compared: a journal holds no secrets, so no token."""
    return payload if message.token is None else encode(msgspec.structs.replace(message, token=None))


def answer_body(code: AnswerCode, reason: str, answer: bytes) -> bytes:
    """Return the body of an answer's row: what its teacher was told, and what they said."""
    return pack([code.word, reason, answer])


def read_answer_body(body: bytes) -> tuple[AnswerCode, str, bytes]:
    """Return (code, reason, answer payload) of an answer's row; raise DecodeError when it is none."""
    row = _read("answer", body, _AnswerRow)
    code = _CODES.get(row.code)
    if code is None:
        detail = f"answer row: {printable(repr(row.code))} is not a valid AnswerCode"
        raise DecodeError(DecodeFault.NOT_THE_SCHEMA, detail)
    return code, row.reason, row.answer


def _read(kind: str, body: bytes, expected: type[T]) -> T:
    """Return the value of the expected type that a row's body holds; raise DecodeError otherwise."""
    try:
        return read(body, expected)
    except DecodeError as error:
        raise DecodeError(error.fault, f"{kind} row: {error.detail}") from None


def event_body(event: Event) -> tuple[Kind, bytes]:
    """Return kind and body of any event but an answer and a step, which have their own functions."""
    match event:
        case WindowElapsed():
            return Kind.ELAPSED, b""
        case EpisodeBegan(episode, state, view, optimal_steps):
            return Kind.BEGAN, pack([episode, state, view, optimal_steps])
        case WindowChanged(by, window, afresh):
            fields = [by, window.mode.value, window.span_ms, window.quorum]
            return Kind.WINDOW, pack([*fields, True] if afresh else fields)
        case TeacherJoined(value) | TeacherLeft(value) | Paused(value) | Resumed(value) | Stopped(value):
            return _KIND_OF[type(event)], pack(value)
        case Restarted(epoch):
            return Kind.RESTARTED, pack(epoch)
        case _:
            message = f"{type(event).__name__} has a body function of its own"
            raise TypeError(message)


def step_body(event: StepTaken, elapsed_at_ns: int | None) -> bytes:
    """Return the body of a transition, with the closing by the clock that led to it, if one did."""
    fields = [
        event.decision,
        event.reward,
        event.outcome.word,
        event.state,
        event.view,
        elapsed_at_ns,
        event.distance,
    ]
    plain = event.action == event.undone == -1
    return pack(fields if plain else [*fields, event.action, event.undone])


def read_step_body(body: bytes) -> tuple[StepTaken, int | None]:
    """Return a transition and the closing by the clock that led to it; raise DecodeError when it is none."""
    action = undone = -1
    try:
        row = _read("step", body, _StepRow)
    except DecodeError:
        row = followed = _read("step", body, _FollowedStepRow)
        action, undone = followed.action, followed.undone
    outcome = _OUTCOMES.get(row.outcome) or Outcome(row.outcome)
    event = StepTaken(row.decision, row.reward, outcome, row.state, row.view, row.distance, action, undone)
    return event, row.elapsed_at_ns


def digest_body(session: Session, q_sha256: str) -> bytes:
    """Return the body of a digest row."""
    return pack([session.decision, session.episode, q_sha256])


@dataclass(slots=True)
class Folded:
    """A session as its rows tell it."""

    session: Session
    config: CreateSession
    actions_taken: list[str] = field(default_factory=list)
    """Names of the actions executed in the running episode, to restore an environment from."""
    known: set[str] = field(default_factory=set)
    """Everybody who ever joined."""
    digests: int = 0
    mismatches: list[int] = field(default_factory=list)
    """Decisions at which a noted digest, or what a teacher was told, differs from the rebuilt session."""
    events: int = 0


def fold(records: Iterable[tuple[str, int, bytes]]) -> Folded | None:
    """Return the session that the records of one session build, or None when it was never created.

    Raises: DecodeError when a body cannot be read.
    """
    folding = Folding()
    folding.take(records)
    return folding.folded


class Folding:
    """A session that is being built of its records, one part after the other.

    Attributes:
        folded: the session as far as its records were taken; None before its first.
    """

    def __init__(self) -> None:
        self.folded: Folded | None = None
        self._actions: tuple[str, ...] = ()
        self._numbers: dict[str, int] = {}

    def take(self, records: Iterable[tuple[str, int, bytes]]) -> None:
        """Go on with the records that follow; after a DecodeError, of a body that cannot be read, no more."""
        rows = iter(records)
        if self.folded is None and (first := next(rows, None)) is not None:
            message = decode(first[2], CreateSession)
            self._actions = action_names(message.world)
            self._numbers = {name: index for index, name in enumerate(self._actions)}
            self.folded = Folded(new_session(config_of(message), len(self._actions)), message)
        if self.folded is None:
            return
        kind = ""
        try:
            for kind, at_ns, body in rows:
                self._apply(self.folded, kind, at_ns, body)
        except (UnknownAction, ValueError, TypeError, IndexError) as error:
            if isinstance(error, DecodeError):
                raise
            raise DecodeError(DecodeFault.NOT_THE_SCHEMA, f"{kind} row: {printable(str(error))}") from None

    def _apply(self, folded: Folded, kind: str, at_ns: int, body: bytes) -> None:
        if kind == _ANSWER:  # its body is read once, for what was said and for what was told
            code, _, payload = read_answer_body(body)
            effects = _happened(folded, at_ns, answer_given(decode(payload, Answer), self._numbers))
            if code is not _told(effects):
                folded.mismatches.append(folded.session.decision)
        elif kind == _STEP:
            taken, elapsed_at_ns = read_step_body(body)
            if elapsed_at_ns is not None:
                _happened(folded, elapsed_at_ns, WindowElapsed())
            action = folded.session.action if taken.action < 0 else taken.action
            folded.actions_taken.append(named(action, self._actions))
            _happened(folded, at_ns, taken)
        elif kind == Kind.DIGEST.value:
            folded.digests += 1
            if _read(kind, body, tuple[Count, Count, str])[2] != folded.session.learner.sha256():
                folded.mismatches.append(folded.session.decision)
        else:
            self._apply_rare(folded, Record(kind, at_ns, body))

    def _apply_rare(self, folded: Folded, record: Record) -> None:
        for at_ns, event in events_of(record, self._numbers):
            if isinstance(event, EpisodeBegan):
                folded.actions_taken.clear()
            elif isinstance(event, TeacherJoined):
                folded.known.add(event.teacher)
            _happened(folded, at_ns, event)


def _happened(folded: Folded, at_ns: int, event: Event) -> tuple[Effect, ...]:
    session = folded.session
    folded.events += 1
    _, effects = advance(session, at_ns, event)
    return effects


def _told(effects: tuple[Effect, ...]) -> AnswerCode | None:
    return effects[0].code if effects and isinstance(effects[0], Acknowledge) else None


def events_of(record: Record, numbers: dict[str, int]) -> Iterator[tuple[int, Event]]:
    """Yield the (at_ns, event) of a row in order; rows that are no events yield nothing."""
    kind, at_ns, body = record
    if kind == _ANSWER:
        yield at_ns, answer_given(decode(read_answer_body(body)[2], Answer), numbers)
    elif kind == _STEP:
        taken, elapsed_at_ns = read_step_body(body)
        if elapsed_at_ns is not None:
            yield elapsed_at_ns, WindowElapsed()
        yield at_ns, taken
    elif kind == Kind.ELAPSED.value:
        yield at_ns, WindowElapsed()
    elif kind not in _NO_EVENT:
        yield at_ns, _small_event(Kind(kind), body)


_ANSWER, _STEP = Kind.ANSWER.value, Kind.STEP.value
_NO_EVENT = {Kind.DIGEST.value, Kind.BRANCHED.value, Kind.CONFLICT.value, Kind.CREATED.value}


def _small_event(kind: Kind, body: bytes) -> Event:
    if kind is Kind.BEGAN:
        return EpisodeBegan(*_read(kind.value, body, tuple[Count, StateKey, View, Count | None]))
    if kind is Kind.WINDOW:
        row = _read(kind.value, body, _WindowRow)
        return WindowChanged(row.by, Window(WindowMode(row.mode), row.span_ms, row.quorum), row.afresh)
    if kind is Kind.RESTARTED:
        return Restarted(_read(kind.value, body, Count))
    return _BY_NAME[kind](_read(kind.value, body, Name))


_BY_NAME: dict[Kind, Callable[[str], Event]] = {
    Kind.JOINED: TeacherJoined,
    Kind.LEFT: TeacherLeft,
    Kind.PAUSED: Paused,
    Kind.RESUMED: Resumed,
    Kind.STOPPED: Stopped,
}
_KIND_OF: dict[Callable[[str], Event], Kind] = {event: kind for kind, event in _BY_NAME.items()}
