"""What a crowd would have come to without somebody: the answers to the learner that are to be corrected."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

import msgspec

from protocol.codec import decode
from protocol.crowd_journal import fold_crowd
from protocol.journal import Record
from protocol.messages import Answer, MistakeMark
from sfid_core.teaching.answers import Answer as Said


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
