"""The flow of a study behind the page: each thing a participant does becomes an event of the book."""

import logging
import re
from collections.abc import Mapping

from services.screens import FINISHED, FlowRefusal, Person, Screen, Value
from services.study.book import Book, NotSaved
from services.study.sessions import Sessions, session_config
from services.study.words import (
    AGREE,
    ANSWER,
    DECLINE,
    GO,
    GO_ON,
    SEND,
    STOP,
    STOP_DELETE,
    STOP_KEEP,
    screen_of,
)
from sfid_core.session.config import WindowMode
from sfid_core.study.definition import Recruiter
from sfid_core.study.effort import SCALES
from sfid_core.study.errors import NotNow
from sfid_core.study.flow import (
    Answered,
    Declined,
    Event,
    Progress,
    Rated,
    Read,
    Standing,
    StepKind,
    StopAsked,
    StopTakenBack,
    Taught,
    Withdrew,
    present_step,
)

log = logging.getLogger("sfid.study")
_PARAMETER = re.compile(r"[A-Za-z0-9_-]{1,128}")
MTURK_PREVIEW = "ASSIGNMENT_ID_NOT_AVAILABLE"
NOT_SAVED = "this could not be saved just now: press it again in a moment"


class StudyFlow:
    """A Flow (services.screens) that leads people through a study; on the gateway's one loop."""

    def __init__(self, book: Book, sessions: Sessions) -> None:
        self._book, self._sessions = book, sessions
        self._came_with: dict[str, dict[str, str]] = {}
        """Parameters of those who are here; they are kept only once their bearer has agreed."""

    def arrive(self, person: Person, arrival: Mapping[str, str]) -> None:
        """See Flow. Whoever is new is taken in; whoever comes back must be the same to the recruiter."""
        book = self._book
        if person.session != book.study.name:
            raise FlowRefusal("this link is for something else: open the link of the study")
        parameters = self._parameters(arrival)
        if person.pseudonym in book.courses:
            self._check_same(person.pseudonym, parameters)
        else:
            self._check_new(person.pseudonym, parameters)
            try:
                book.join(person.pseudonym)
            except NotSaved as error:
                log.warning("a participant could not be taken in: %s", error)
                raise FlowRefusal("the study cannot take you in just now: try again in a moment") from None
        if parameters:
            self._came_with[person.pseudonym] = parameters
        self._prepare(person.pseudonym)

    def screen(self, person: Person) -> Screen:
        """See Flow."""
        return screen_of(self._book.study, self._book.progress(person.pseudonym), person.pseudonym)

    def submit(self, person: Person, screen: str, button: str, values: Mapping[str, Value]) -> None:
        """See Flow."""
        progress = self._book.progress(person.pseudonym)
        if screen != screen_of(self._book.study, progress, person.pseudonym).name:
            return  # pressed twice: what holds now is shown
        try:
            if button == AGREE:
                parameters = self._came_with.get(person.pseudonym, {})
                self._check_new(person.pseudonym, parameters)
                self._book.consent(person.pseudonym, parameters)
            else:
                event = self._event(progress, screen, button, values)
                if event is None:
                    return
                self._book.add(person.pseudonym, event)
        except NotNow as error:
            raise FlowRefusal(str(error)) from None
        except NotSaved as error:
            log.warning("what a participant did could not be saved: %s", error)
            raise FlowRefusal(NOT_SAVED) from None
        self._prepare(person.pseudonym)

    def depart(self, person: Person) -> None:
        """See Flow. A lesson against the clock waits for who is not there."""
        self._came_with.pop(person.pseudonym, None)
        if person.pseudonym in self._book.courses:
            self._hold(person.pseudonym, on=True)

    # ------------------------------------------------------------ what they did

    def _event(
        self, progress: Progress, screen: str, button: str, values: Mapping[str, Value]
    ) -> Event | None:
        """Return the event that a button means; None where it means nothing (yet)."""
        kind = present_step(self._book.study, progress).kind
        simple: dict[str, Event] = {
            STOP: StopAsked(),
            GO_ON: StopTakenBack(),
            STOP_KEEP: Withdrew(erase=False),
            STOP_DELETE: Withdrew(erase=True),
            DECLINE: Declined(),
            GO: Read(screen),
        }
        if button in simple:
            return simple[button]
        if button == FINISHED:
            return Taught(screen) if kind is StepKind.TEACH and screen != STOP else None
        if button == SEND:
            ratings = (values.get(scale.name) for scale in SCALES)
            return Rated(screen, tuple(int(one) for one in ratings if isinstance(one, int | float)))
        if button == ANSWER:
            # The page leaves a field of text empty where nothing was written.
            return Answered(screen, {name: None if given == "" else given for name, given in values.items()})
        raise FlowRefusal("that button is not of this page: reload it")

    def _prepare(self, pseudonym: str) -> None:
        """Have the person's present session created, and that of one who stopped ended."""
        study, progress = self._book.study, self._book.progress(pseudonym)
        step = present_step(study, progress)
        if step.kind is not StepKind.TEACH:
            return
        if progress.standing is Standing.TAKING_PART:
            self._sessions.create(session_config(study, progress, pseudonym, step.period))
            self._hold(pseudonym, on=progress.stopping)
        else:
            self._sessions.stop(study.session(pseudonym, step.period))

    def _hold(self, pseudonym: str, *, on: bool) -> None:
        """Pause the person's lesson, or let it go on; one that waits for every answer waits by itself."""
        study, progress = self._book.study, self._book.progress(pseudonym)
        step = present_step(study, progress)
        if (
            step.kind is StepKind.TEACH
            and study.lesson(step.period).window.mode is not WindowMode.UNTIL_ANSWERED
        ):
            self._sessions.hold(study.session(pseudonym, step.period), on=on)

    # ------------------------------------------------------------ who they are

    def _parameters(self, arrival: Mapping[str, str]) -> dict[str, str]:
        names = self._book.study.recruiter.parameters
        return {name: arrival[name] for name in names if _PARAMETER.fullmatch(arrival.get(name, ""))}

    def _check_new(self, pseudonym: str, parameters: Mapping[str, str]) -> None:
        recruiter = self._book.study.recruiter
        if recruiter is Recruiter.NONE:
            return
        if parameters.get("assignmentId") == MTURK_PREVIEW:
            raise FlowRefusal("this is a preview: accept the HIT, then open the link again")
        who = recruiter.parameters[0]
        if who not in parameters:
            raise FlowRefusal(
                f"the link says not who you are ({who}): open the study from where you found it"
            )
        if self._book.people.owner(who, parameters[who]) not in {None, pseudonym}:
            raise FlowRefusal("you have begun in another browser: go on there, everybody takes part once")

    def _check_same(self, pseudonym: str, parameters: Mapping[str, str]) -> None:
        known = self._book.people.of(pseudonym) or self._came_with.get(pseudonym, {})
        who = self._book.study.recruiter.parameters[:1]
        if any(name in known and parameters.get(name, known[name]) != known[name] for name in who):
            raise FlowRefusal(
                "somebody else takes part in this browser: use another one, or a private window"
            )
