"""The book of a running study: every event in its own journal before it counts, and who is who."""

import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Self

from services.runtime.clock import Clock
from services.runtime.journal import JournalError, Shard
from services.study.people import People
from services.study.records import Kind, courses, definition_body, row_of, take
from sfid_core.study.assignment import order_of
from sfid_core.study.definition import Study
from sfid_core.study.errors import StudyError
from sfid_core.study.flow import Consented, Event, Joined, Progress, Withdrew, advance

_LETTERS = "ABCDEFGHJKMNPQRSTUVWXYZ23456789"
_CODE_LETTERS = 8


def study_folder(data: Path, name: str) -> Path:
    """Return where a study of a deployment keeps its journal and its people."""
    return data / f"study-{name}"


class NotSaved(Exception):  # noqa: N818 - a state of the disk
    """An event could not be made durable; it does not count."""


class Book:
    """The only writer of a study; on one thread. Open it with `Book.open`."""

    def __init__(self, study: Study, shard: Shard, people: People, clock: Clock) -> None:
        self.study, self.people = study, people
        self._shard, self._clock = shard, clock
        before, self.courses = courses(shard.rows(study.name))
        _check_change(study, before, people_came=bool(self.courses))
        if before != study:
            self._append(Kind.DEFINED.value, definition_body(study), None)

    @classmethod
    def open(cls, study: Study, data: Path, clock: Clock) -> Self:
        """Open or begin a study. Raises JournalError, StudyError."""
        folder = study_folder(data, study.name)
        shard = Shard.open(folder)
        try:
            return cls(study, shard, People(folder), clock)
        except BaseException:
            shard.close()
            raise

    def close(self) -> None:
        """Give the journal back."""
        self._shard.close()

    def progress(self, pseudonym: str) -> Progress:
        """Return how far a person is; they must have joined."""
        return self.courses[pseudonym].progress

    def join(self, pseudonym: str) -> None:
        """Note somebody who is new. Raises NotSaved."""
        code = self.study.completion_code or "".join(secrets.choice(_LETTERS) for _ in range(_CODE_LETTERS))
        self.add(pseudonym, Joined(code))

    def consent(self, pseudonym: str, parameters: Mapping[str, str]) -> None:
        """Note that a person agrees to the present text, and only now who they are to their recruiter.

        They get the next number. Raises as `add`.
        """
        try:
            if parameters:
                self.people.note(pseudonym, parameters)
        except OSError as error:
            raise NotSaved(str(error)) from error
        numbers = [course.progress.number for course in self.courses.values()]
        number = 1 + max((one for one in numbers if one is not None), default=-1)
        names = tuple(self.study.conditions[place].name for place in order_of(self.study, number))
        text = self.study.consent
        self.add(pseudonym, Consented(text.version, text.sha256, number, names))

    def add(self, pseudonym: str, event: Event) -> None:
        """Make an event of a person durable, then let it count. Raises NotNow, NotSaved."""
        course = self.courses.get(pseudonym)
        advance(self.study, Progress() if course is None else course.progress, event)
        at_ns = self._append(*row_of(event), pseudonym)
        take(self.study, self.courses, pseudonym, event, at_ns)
        if isinstance(event, Withdrew) and event.erase:
            self.people.forget(pseudonym)

    def _append(self, kind: str, body: bytes, person: str | None) -> int:
        at_ns = self._clock.wall_ns()
        try:
            self._shard.append(self.study.name, kind, body, at_ns=at_ns, person=person)
            self._shard.commit()
        except JournalError as error:
            self._shard.discard_pending()
            raise NotSaved(str(error)) from error
        return at_ns


def _check_change(study: Study, before: Study | None, *, people_came: bool) -> None:
    """Refuse a change that would make people of one study take part in two."""
    if before is None:
        return
    if study.consent.version == before.consent.version and study.consent.text != before.consent.text:
        raise StudyError(
            f"study {study.name}: the consent text changed and its version is still {before.consent.version}:"
            " give the new text a new version"
        )
    if not people_came:
        return
    for name in ("conditions", "design", "seed", "teaching", "practice", "effort", "questions", "recruiter"):
        if getattr(study, name) != getattr(before, name):
            raise StudyError(
                f"study {study.name}: {name} changed since people took part: put it back, or give the "
                "changed study another name"
            )
