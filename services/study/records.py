"""Events of a study as rows of its journal, and rows as participants again."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import msgspec

from services.runtime.journal import Row
from sfid_core.study.definition import Study
from sfid_core.study.errors import NotNow, StudyError
from sfid_core.study.flow import (
    Answered,
    Consented,
    Declined,
    Event,
    Joined,
    Progress,
    Rated,
    Read,
    StopAsked,
    StopTakenBack,
    Taught,
    Withdrew,
    advance,
)


class Kind(Enum):
    """Kinds of rows in the journal of a study."""

    DEFINED = "defined"
    """The study as it is from here on, whole; no event of a person."""
    JOINED = "joined"
    CONSENTED = "consented"
    DECLINED = "declined"
    READ = "read"
    TAUGHT = "taught"
    RATED = "rated"
    ANSWERED = "answered"
    STOP_ASKED = "stop-asked"
    STOP_TAKEN_BACK = "stop-taken-back"
    WITHDREW = "withdrew"


_EVENTS: dict[Kind, type[Any]] = {
    Kind.JOINED: Joined,
    Kind.CONSENTED: Consented,
    Kind.DECLINED: Declined,
    Kind.READ: Read,
    Kind.TAUGHT: Taught,
    Kind.RATED: Rated,
    Kind.ANSWERED: Answered,
    Kind.STOP_ASKED: StopAsked,
    Kind.STOP_TAKEN_BACK: StopTakenBack,
    Kind.WITHDREW: Withdrew,
}
_KINDS = {event: kind for kind, event in _EVENTS.items()}


@dataclass(slots=True)
class Course:
    """One participant as the journal tells: how far they are, and when each thing happened."""

    progress: Progress
    joined_ns: int
    """Nanoseconds since 1970, as all times here."""
    last_ns: int
    times: list[tuple[str, int]]
    """(step, when it ended) in order, as far as it was ended by them."""


def row_of(event: Event) -> tuple[str, bytes]:
    """Return kind and body of an event's row."""
    return _KINDS[type(event)].value, msgspec.json.encode(event)


def event_of(row: Row) -> Event:
    """Return the event in a row that has its body. Raises StudyError."""
    try:
        kind = Kind(row.kind)
        event: Event = msgspec.json.decode(row.body or b"", type=_EVENTS[kind])
    except (ValueError, KeyError, msgspec.DecodeError) as error:
        raise StudyError(f"row {row.seq} of the study's journal: {error}: run `sfid verify`") from None
    return event


def definition_body(study: Study) -> bytes:
    """Return the body of a row that holds a study."""
    return msgspec.json.encode(study)


def read_definition(row: Row) -> Study:
    """Return the study in a row. Raises StudyError."""
    try:
        return msgspec.json.decode(row.body or b"", type=Study)
    except msgspec.DecodeError as error:
        raise StudyError(f"row {row.seq} of the study's journal: {error}: run `sfid verify`") from None


def courses(rows: Iterable[Row]) -> tuple[Study | None, dict[str, Course]]:
    """Return the newest definition and all participants by pseudonym. Raises StudyError."""
    study: Study | None = None
    found: dict[str, Course] = {}
    for row in rows:
        if row.kind == Kind.DEFINED.value:
            study = read_definition(row)
        elif row.person is not None and row.body is not None and study is not None:
            try:
                take(study, found, row.person, event_of(row), row.at_ns)
            except NotNow as error:
                raise StudyError(
                    f"row {row.seq} of the study's journal does not follow ({error}): run `sfid verify`"
                ) from None
    return study, found


def take(study: Study, found: dict[str, Course], pseudonym: str, event: Event, at_ns: int) -> None:
    """Take one event into the participants. Raises NotNow; nothing has changed then."""
    course = found.get(pseudonym)
    progress = advance(study, Progress() if course is None else course.progress, event)
    if course is None:
        found[pseudonym] = Course(progress, at_ns, at_ns, [])
        return
    if progress.at > course.progress.at:
        course.times.append((step_ended(event), at_ns))
    course.progress, course.last_ns = progress, at_ns


def step_ended(event: Event) -> str:
    """Return the name of the step that an event ends."""
    match event:
        case Read(step) | Taught(step) | Rated(step) | Answered(step):
            return step
        case _:
            return "consent"
