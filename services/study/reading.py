"""A study as its journals tell it, also while it runs: participants, and what they taught."""

from collections import defaultdict
from pathlib import Path

from protocol.codec import DecodeError
from protocol.journal import Kind, Record, fold
from services.runtime.journal import JournalError, read_rows
from services.study.book import study_folder
from services.study.records import Course, courses
from sfid_core.session.state import Phase
from sfid_core.study.definition import Study
from sfid_core.study.errors import StudyError
from sfid_core.study.results import Participant, Taught

NS_PER_S = 1_000_000_000


class NoDataError(StudyError):
    """There is nothing to read yet, or it cannot be read; one line, with the mend."""


def read_courses(data: Path, name: str) -> tuple[Study, dict[str, Course]]:
    """Return a study as it was last defined, and its people. Raises NoDataError."""
    try:
        study, people = courses(read_rows(study_folder(data, name), name))
    except JournalError as error:
        raise NoDataError(f"study {name} has no data ({error}): `sfid study run` begins it") from None
    except StudyError as error:
        raise NoDataError(str(error)) from None
    if study is None:
        raise NoDataError(f"study {name} has no data in {data}: `sfid study run` begins it")
    return study, people


def read_participants(data: Path, name: str) -> tuple[Study, list[Participant]]:
    """Return a study and everybody who agreed to take part, by number; the deleted are not among them.

    Raises: NoDataError.
    """
    study, people = read_courses(data, name)
    wanted = {
        study.session(pseudonym, period): (pseudonym, period)
        for pseudonym, course in people.items()
        for period in range(1, study.periods + 1)
        if course.progress.standing.is_kept and course.progress.number is not None
    }
    lessons = _lessons(data, wanted)
    found = [
        _participant(study, pseudonym, course, lessons.get(pseudonym, {}))
        for pseudonym, course in people.items()
        if course.progress.standing.is_kept and course.progress.number is not None
    ]
    return study, sorted(found, key=lambda one: one.number)


def _lessons(data: Path, wanted: dict[str, tuple[str, int]]) -> dict[str, dict[int, Taught]]:
    """Return what was taught, by pseudonym and period, from the learner's journal."""
    records: dict[str, list[Record]] = defaultdict(list)
    try:
        for row in read_rows(data):
            if row.session in wanted and row.body is not None:
                records[row.session].append(Record(row.kind, row.at_ns, row.body))
    except JournalError:
        if wanted:
            raise
    found: dict[str, dict[int, Taught]] = defaultdict(dict)
    for session, (pseudonym, period) in wanted.items():
        try:
            folded = fold(records[session])
        except DecodeError as error:
            raise NoDataError(
                f"session {session}: a row cannot be read ({error}): run `sfid verify`"
            ) from None
        if folded is not None:
            taught = folded.session
            is_whole = taught.phase is Phase.FINISHED and taught.episode == taught.config.episodes
            present_ns = max(0, taught.teaching_ns - _absent_ns(records[session]))
            found[pseudonym][period] = Taught(
                tuple(taught.episodes),
                present_ns / NS_PER_S,
                taught.counts.submitted,
                is_whole=is_whole,
            )
    return found


def _absent_ns(records: list[Record]) -> int:
    """Return how long the session's only teacher was away between joining for the first and the last time."""
    absent, left_ns = 0, None
    for record in records:
        if record.kind == Kind.LEFT.value:
            left_ns = record.at_ns
        elif record.kind == Kind.JOINED.value and left_ns is not None:
            absent, left_ns = absent + record.at_ns - left_ns, None
    return absent


def _participant(study: Study, pseudonym: str, course: Course, lessons: dict[int, Taught]) -> Participant:
    progress = course.progress
    return Participant(
        pseudonym=pseudonym,
        number=progress.number or 0,
        standing=progress.standing,
        at=progress.at,
        conditions=tuple(study.conditions[place].name for place in progress.order),
        consent=progress.consent,
        code=progress.code,
        began_s=course.joined_ns / NS_PER_S,
        seconds=(course.last_ns - course.joined_ns) / NS_PER_S,
        lessons=lessons,
        ratings=dict(progress.ratings),
        answers=dict(progress.answers),
    )
