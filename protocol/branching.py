"""A session taken up again from an earlier episode: the rows that a branch's journal begins with.

A branch has a journal of its own, so replay, verification, export and forgetting need nothing else. It
begins with its creation and a copy of its origin's rows before the episode, then says where they are from.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import msgspec

from protocol.codec import decode, encode, pack, read
from protocol.fields import Count, Name
from protocol.journal import Kind, Record, events_of, read_step_body, step_body
from protocol.messages import CreateSession
from protocol.translate import action_names, config_of
from sfid_core.session.events import StepTaken
from sfid_core.session.machine import advance
from sfid_core.session.state import new_session


class Origin(NamedTuple):
    """Where a branch comes from."""

    session: str
    seq: int
    """The first row of the origin that the branch does not have."""
    episode: int
    """The episode that the branch begins with."""


def origin_body(origin: Origin) -> bytes:
    """Return the body of a row that says where the rows before it are from."""
    return pack(list(origin))


def read_origin(body: bytes) -> Origin:
    """Return where a branch comes from; raise DecodeError when the body says nothing of the kind."""
    return Origin(*read(body, tuple[Name, Count, Count]))


def rows_before(records: Sequence[Record], episode: int) -> int | None:
    """Return how many rows stand before the beginning of an episode; None when it has not begun."""
    for number, record in enumerate(records):
        if record.kind == Kind.BEGAN.value:
            ((_, event),) = events_of(record, {})
            if getattr(event, "episode", -1) == episode:
                return number
    return None


def branch_records(records: Iterable[Record], name: str) -> Iterator[Record]:
    """Yield the rows of an origin as those of a branch of that name, one for one.

    Chance is named by the session, so a branch would have chosen otherwise: each step says what was done.

    Args: records: of the origin, its creation first, erased ones left out. Raises: DecodeError.
    """
    rows = iter(records)
    created = next(rows)
    config = decode(created.body, CreateSession)
    yield created._replace(body=encode(msgspec.structs.replace(config, session=name)))
    actions = action_names(config.world)
    numbers = {action: index for index, action in enumerate(actions)}
    session = new_session(config_of(config), len(actions))
    for record in rows:
        told = record
        for at_ns, event in events_of(record, numbers):
            if isinstance(event, StepTaken) and event.action < 0:
                _, elapsed_at_ns = read_step_body(record.body)
                told = record._replace(body=step_body(replace(event, action=session.action), elapsed_at_ns))
            advance(session, at_ns, event)
        yield told
