"""What is to be erased of those who wished it: rows by journal, session and person, for whoever erases."""

from pathlib import Path
from typing import NamedTuple

from services.runtime.journal import read_rows
from services.study.book import study_folder
from services.study.reading import read_courses
from sfid_core.study.flow import Standing


class Erasure(NamedTuple):
    """All rows of a session that speak of a person, in the journal of one data directory."""

    data: Path
    session: str
    person: str


def erasures(data: Path, name: str) -> tuple[Erasure, ...]:
    """Return what is left to erase of a study's people who had their answers deleted, by person.

    Their lessons are sessions of their own in the learner's journal; the way through the study is in the
    study's. What has been erased is not listed again.  Raises: NoDataError, JournalError.
    """
    study, people = read_courses(data, name)
    gone = [who for who, course in people.items() if course.progress.standing is Standing.ERASED]
    lessons = {
        study.session(who, period): Erasure(data, study.session(who, period), who)
        for who in gone
        for period in range(study.periods + 1)
    }
    left = {
        lessons[row.session]
        for row in read_rows(data)
        if row.session in lessons and row.body is not None and row.person is not None
    }
    own = {Erasure(study_folder(data, name), name, who) for who in gone}
    return tuple(sorted(left | own, key=lambda one: (one.person, one.session)))
