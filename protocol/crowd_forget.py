"""What a crowd would have come to without somebody: the answers to the learner that are to be corrected."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

import msgspec

from protocol.codec import decode, encode
from protocol.crowd_journal import (
    CrowdKind,
    FoldedCrowd,
    ReliabilityRow,
    apply_row,
    fold_crowd,
    read_body,
    read_config,
    reliability_row,
    row_body,
)
from protocol.fields import Name
from protocol.journal import Record, read_answer_body
from protocol.messages import Answer, MistakeMark
from sfid_core.crowd.round import Crowd
from sfid_core.teaching.answers import Answer as Said
from sfid_core.teaching.answers import AnswerKind


@dataclass(frozen=True, slots=True)
class Corrected:
    """An answer to the learner as it was handed on, and as it would have been."""

    before: Answer
    after: Answer | None
    """Under the same id, so that it takes the place of the other in the learner's journal; None: nobody else
    had answered, so nothing would have been handed on."""


def corrected_answers(records: Iterable[Record], without: Collection[str]) -> Iterator[Corrected]:
    """Yield the answers that come out otherwise without these workers, in order.

    Rounds close where they closed. Args: records: an aggregator's journal of one session; answers that are
    erased already are left out like those of `without`.
    Raises: DecodeError when a body cannot be read.
    """
    folded = fold_crowd(records, without)
    if folded is None:
        return
    for row, said in folded.closings:
        if row.handed:
            before = decode(row.handed, Answer)
            after = None if said is None else said_instead(before, said, folded.config.actions)
            if after != before:
                yield Corrected(before, after)


def said_instead(message: Answer, said: Said, actions: tuple[str, ...]) -> Answer:
    """Return an aggregator's answer with another content."""
    return msgspec.structs.replace(
        message,
        kind=said.kind.value,
        action=None if said.action is None else actions[said.action],
        reward=said.reward,
        guidance=tuple(actions[action] for action in said.guidance),
        mistake=None
        if said.steps is None
        else MistakeMark(first_step=said.steps[0], last_step=said.steps[1]),
        posterior=dict(zip(actions, said.posterior, strict=True)) if said.posterior else None,
    )


def forget_in_crowd(rows: Iterable[tuple[int, Record]], person: str) -> dict[int, bytes | None]:
    """Return what is to be erased of a worker in one session's crowd: by row, what is read there from now on.

    What the crowd handed on, and what was known of the others, is as it would have been without the worker.
    Args: rows: (number, record) of the session, in order, erased ones left out.
    Raises: DecodeError when a body cannot be read.
    """
    known = list(rows)
    if not known or known[0][1].kind != CrowdKind.CREATED.value:
        return {}
    config = read_config(known[0][1].body)
    numbers = {name: index for index, name in enumerate(config.actions)}
    folded = FoldedCrowd(Crowd(config.rounds, config.weighing, len(config.actions)), config)
    amendments: dict[int, bytes | None] = {}
    answered = False
    for seq, record in known[1:]:
        apply_row(folded, record, numbers, {person})
        body: bytes | None = record.body
        if record.kind == CrowdKind.ASKED.value:
            answered = False
        elif record.kind == CrowdKind.CLOSED.value:
            body = _closed_without(folded, answered=answered)
        elif record.kind == CrowdKind.RELIABILITY.value:
            body = _known_without(folded, record, person)
        elif _is_of(record, person):
            body = None
            answered = answered or record.kind == CrowdKind.ANSWER.value
        if body != record.body:
            amendments[seq] = body
    return amendments


def _is_of(record: Record, person: str) -> bool:
    if record.kind in {CrowdKind.JOINED.value, CrowdKind.LEFT.value}:
        return read_body(record.kind, record.body, Name) == person
    if record.kind == CrowdKind.ANSWER.value:
        return decode(read_answer_body(record.body)[2], Answer).teacher == person
    return record.kind == CrowdKind.CONFLICT.value and decode(record.body, Answer).teacher == person


def _closed_without(folded: FoldedCrowd, *, answered: bool) -> bytes:
    row, said = folded.closings[-1]
    if not row.handed:
        return row_body(row)
    before = decode(row.handed, Answer)
    after = None if said is None else said_instead(before, said, folded.config.actions)
    if after == before:
        return row_body(row)
    posterior = () if said is None or not said.posterior else tuple(said.posterior)
    return row_body(
        msgspec.structs.replace(
            row,
            answered=max(0, row.answered - answered),
            posterior=posterior,
            handed=b"" if after is None else encode(after),
        )
    )


def _known_without(folded: FoldedCrowd, record: Record, person: str) -> bytes | None:
    row = read_body(record.kind, record.body, ReliabilityRow)
    if row.worker == person:
        return None
    kind = AnswerKind(row.kind)
    return row_body(reliability_row(kind, row.worker, folded.crowd.aggregate(kind).reliability(row.worker)))
