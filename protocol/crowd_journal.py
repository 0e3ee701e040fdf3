"""The journal of an aggregator: rows of one session's crowd, and rows as a crowd again.

A closing names what was handed on to the learner under an id of its own, so this journal and the learner's
join on that id. Who said what is in the answers' rows, as their workers sent it, without the identity token.
"""

from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any, NamedTuple, TypeVar, cast

import msgspec

from protocol.codec import DecodeError, DecodeFault, decode, pack, printable, read
from protocol.fields import ActionNames, Count, Finite, Milliseconds, Name, StateKey, View
from protocol.journal import Record, read_answer_body
from protocol.messages import Answer
from protocol.translate import UnknownAction, answer_given
from sfid_core.crowd.round import (
    Acknowledged,
    Answered,
    Asked,
    Cause,
    Closed,
    Concluded,
    Crowd,
    MemberJoined,
    MemberLeft,
    RoundSettings,
    advance,
)
from sfid_core.crowd.settings import CrowdSettings
from sfid_core.crowd.tally import Reliability
from sfid_core.learning.parameters import ParameterError
from sfid_core.session.effects import AnswerCode
from sfid_core.teaching.answers import Answer as Said
from sfid_core.teaching.answers import AnswerKind

T = TypeVar("T")
_Setting = bool | int | float | str | None
"""What a setting of a crowd can be on disk."""
HANDED_KEPT = 16
"""Conclusions that are remembered, in case the learner asks the same again."""


class CrowdKind(Enum):
    """Kinds of rows."""

    CREATED = "crowd"
    JOINED = "joined"
    LEFT = "left"
    ASKED = "asked"
    """A decision was put to the crowd: from here on its workers could see it."""
    ANSWER = "answer"
    CLOSED = "closed"
    """The round ended; what it came to, and what was handed on under which id."""
    RELIABILITY = "reliability"
    """No event: what was known of a worker at this point."""
    CONFLICT = "conflict"
    """No event: an answer that came under the id of another; kept for audit, never counted."""
    FINISHED = "finished"
    """No event: the learner's session is over."""


class CrowdConfig(NamedTuple):
    """What a session's crowd was created with; it holds for all of the session."""

    aggregator: str
    """The name under which the crowd teaches."""
    actions: tuple[str, ...]
    rounds: RoundSettings
    weighing: CrowdSettings


class AskedRow(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A decision as it was put to the crowd; `epoch` is the learner's."""

    epoch: Count
    decision: Count
    episode: Count
    step: Count
    state: StateKey
    view: View
    asked: Name
    judged: Count | None
    remaining_ms: Milliseconds | None
    full: bool
    held: bool
    optimal: tuple[Count, ...]
    gold: bool


class ClosedRow(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """How a round ended; `handed` is the payload of the answer to the learner, empty without one."""

    decision: Count
    cause: Name
    answered: Count
    posterior: tuple[Finite, ...]
    handed: bytes


class ReliabilityRow(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What was known of a worker's answers of a kind."""

    kind: Name
    worker: Name
    mean: Finite
    standard_error: Finite
    labels: Count


# ---------------------------------------------------------------- writing


def config_body(config: CrowdConfig) -> bytes:
    """Return the body of a crowd's first row."""
    return pack([config.aggregator, list(config.actions), asdict(config.rounds), asdict(config.weighing)])


def row_body(row: AskedRow | ClosedRow | ReliabilityRow) -> bytes:
    """Return the body of a row that has fields of its own."""
    return pack(row)


def name_body(worker: str) -> bytes:
    """Return the body of a joined or left row."""
    return pack(worker)


def asked_event(row: AskedRow) -> Asked:
    """Return a decision put to the crowd as an event."""
    return Asked(
        row.decision,
        row.state,
        AnswerKind(row.asked),
        row.judged,
        row.remaining_ms,
        row.full,
        row.held,
        row.optimal,
        row.gold,
    )


def reliability_row(kind: AnswerKind, worker: str, known: Reliability) -> ReliabilityRow:
    """Return what is known of a worker, to be noted."""
    return ReliabilityRow(kind.value, worker, known.mean, known.standard_error, known.labels)


# ---------------------------------------------------------------- reading


def read_config(body: bytes) -> CrowdConfig:
    """Return what a crowd was created with; raise DecodeError when it cannot be read by this version."""
    name, actions, rounds, weighing = read_body(
        CrowdKind.CREATED.value, body, tuple[Name, ActionNames, dict[str, _Setting], dict[str, _Setting]]
    )
    try:
        rules = RoundSettings(**cast("dict[str, Any]", rounds))
        return CrowdConfig(name, actions, rules, CrowdSettings(**cast("dict[str, Any]", weighing)))
    except (TypeError, ParameterError) as error:
        raise DecodeError(DecodeFault.NOT_THE_SCHEMA, f"crowd row: {printable(str(error))}") from None


def read_body(kind: str, body: bytes, expected: type[T]) -> T:
    """Return the value of the expected type that a row's body holds; raise DecodeError otherwise."""
    try:
        return read(body, expected)
    except DecodeError as error:
        raise DecodeError(error.fault, f"{kind} row: {error.detail}") from None


@dataclass(slots=True)
class Handed:
    """An answer that was handed on to the learner; `payload` is it without the identity token."""

    decision: int
    state: bytes
    asked: str
    """What was asked: a decision can have two questions."""
    payload: bytes


@dataclass(slots=True)
class FoldedCrowd:
    """A session's crowd as its rows tell it."""

    crowd: Crowd
    config: CrowdConfig
    known: set[str] = field(default_factory=set)
    """Everybody who ever joined."""
    asked: AskedRow | None = None
    """What was put to the crowd last."""
    handed: deque[Handed] = field(default_factory=lambda: deque(maxlen=HANDED_KEPT))
    closings: list[tuple[ClosedRow, Said | None]] = field(default_factory=list)
    """Each closing as it was noted, and what the answers that are left come to now; None where nothing was
    handed on."""
    mismatches: list[int] = field(default_factory=list)
    """Decisions at which a code, a conclusion or a noted reliability comes out differently."""
    finished: bool = False


def fold_crowd(records: Iterable[Record], without: Collection[str] = ()) -> FoldedCrowd | None:
    """Return the crowd that the records of one session build, None when there is none.

    Args: without: workers whose answers are left out, as if they had never been; closings stay where they
    were, so the mismatches then say where the workers made a difference.
    Raises: DecodeError when a body cannot be read.
    """
    folded: FoldedCrowd | None = None
    numbers: dict[str, int] = {}
    for record in records:
        if folded is None:
            config = read_config(record.body)
            numbers = {name: index for index, name in enumerate(config.actions)}
            folded = FoldedCrowd(Crowd(config.rounds, config.weighing, len(config.actions)), config)
            continue
        apply_row(folded, record, numbers, without)
    return folded


def apply_row(
    folded: FoldedCrowd, record: Record, numbers: dict[str, int], without: Collection[str] = ()
) -> None:
    """Let a row after the first take effect on what the rows before it built.

    Args: numbers: the session's actions by name; without: as for `fold_crowd`.
    Raises: DecodeError when its body cannot be read.
    """
    try:
        _APPLY[CrowdKind(record.kind)](folded, record, numbers, without)
    except DecodeError:
        raise
    except (UnknownAction, ValueError, KeyError) as error:
        detail = f"{record.kind} row: {printable(str(error))}"
        raise DecodeError(DecodeFault.NOT_THE_SCHEMA, detail) from None


def _came_or_went(
    folded: FoldedCrowd, record: Record, _numbers: dict[str, int], without: Collection[str]
) -> None:
    worker = read_body(record.kind, record.body, Name)
    if worker in without:
        return
    joined = record.kind == CrowdKind.JOINED.value
    advance(folded.crowd, record.at_ns, MemberJoined(worker) if joined else MemberLeft(worker))
    folded.known.add(worker)


def _asked(folded: FoldedCrowd, record: Record, _numbers: dict[str, int], _without: Collection[str]) -> None:
    folded.asked = read_body(record.kind, record.body, AskedRow)
    advance(folded.crowd, record.at_ns, asked_event(folded.asked))


def _answer(folded: FoldedCrowd, record: Record, numbers: dict[str, int], without: Collection[str]) -> None:
    code, _, payload = read_answer_body(record.body)
    message = decode(payload, Answer)
    if message.teacher in without:
        return
    effects = advance(folded.crowd, record.at_ns, answered_event(message, numbers))
    told = effects[0].code if effects and isinstance(effects[0], Acknowledged) else None
    # Superseded or late hangs on deadlines that a restart has moved; whether an answer counts does not.
    if (told is AnswerCode.ACCEPTED) is not (code is AnswerCode.ACCEPTED):
        folded.mismatches.append(message.decision)


def answered_event(message: Answer, numbers: dict[str, int]) -> Answered:
    """Return a worker's answer as an event; raise UnknownAction when it names none of the session's."""
    event = answer_given(message, numbers)
    return Answered(event.teacher, event.answer_id, event.decision, event.state, event.answer)


def _closed(folded: FoldedCrowd, record: Record, numbers: dict[str, int], _without: Collection[str]) -> None:
    row = read_body(record.kind, record.body, ClosedRow)
    concluded = next(
        (
            effect
            for effect in advance(folded.crowd, record.at_ns, Closed(Cause(row.cause)))
            if isinstance(effect, Concluded)
        ),
        None,
    )
    answer = None if concluded is None else concluded.answer
    folded.closings.append((row, answer))
    noted: Said | None = None
    if row.handed:
        message = decode(row.handed, Answer)
        noted = answer_given(message, numbers).answer
        asked = "" if folded.asked is None else folded.asked.asked
        folded.handed.append(Handed(message.decision, message.state, asked, row.handed))
    if noted != answer:
        folded.mismatches.append(row.decision)


def _reliability(
    folded: FoldedCrowd, record: Record, _numbers: dict[str, int], without: Collection[str]
) -> None:
    row = read_body(record.kind, record.body, ReliabilityRow)
    kind = AnswerKind(row.kind)
    if row.worker in without:
        return
    if reliability_row(kind, row.worker, folded.crowd.aggregate(kind).reliability(row.worker)) != row:
        folded.mismatches.append(max((known[0] for known in folded.crowd.closed), default=0))


def _nothing(
    _folded: FoldedCrowd, _record: Record, _numbers: dict[str, int], _without: Collection[str]
) -> None:
    """Conflicts are kept for audit alone."""


def _finished(
    folded: FoldedCrowd, _record: Record, _numbers: dict[str, int], _without: Collection[str]
) -> None:
    folded.finished = True


_APPLY = {
    CrowdKind.JOINED: _came_or_went,
    CrowdKind.LEFT: _came_or_went,
    CrowdKind.ASKED: _asked,
    CrowdKind.ANSWER: _answer,
    CrowdKind.CLOSED: _closed,
    CrowdKind.RELIABILITY: _reliability,
    CrowdKind.CONFLICT: _nothing,
    CrowdKind.FINISHED: _finished,
}
