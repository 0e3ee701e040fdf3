"""What a study is: its consent, conditions, design and lessons."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from hashlib import sha256

from sfid_core.session.config import Window
from sfid_core.study.errors import StudyError

CONDITIONS_MAX = 8
NAME_LENGTH_MAX = 24
"""A participant's session is named STUDY-PSEUDONYM-PERIOD, in 48 letters."""


class Design(Enum):
    """Who meets which conditions."""

    BETWEEN = "between"
    """Everybody one condition."""
    WITHIN = "within"
    """Everybody all conditions, in an order of their own."""


class Recruiter(Enum):
    """Where participants come from, which says how they are named there."""

    NONE = "none"
    PROLIFIC = "prolific"
    MTURK = "mturk"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the address's parameters that are kept, that of the person first."""
        return _PARAMETERS[self]


_PARAMETERS = {
    Recruiter.NONE: (),
    Recruiter.PROLIFIC: ("PROLIFIC_PID", "STUDY_ID", "SESSION_ID"),
    Recruiter.MTURK: ("workerId", "assignmentId", "hitId"),
}


@dataclass(frozen=True, slots=True)
class Consent:
    """What people agree to."""

    version: str
    text: str

    @property
    def sha256(self) -> str:
        """Return the SHA-256 of the text in UTF-8, which is kept with each consent."""
        return sha256(self.text.encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class Condition:
    """One way of teaching that is compared."""

    name: str
    method: str
    """A learning method by name."""
    teacher: str = "people"
    """The second factor of the design, where there is one: what sort of teachers these are told to be."""
    instructions: str = ""
    """What participants read before they teach; the method's own words where it is empty."""
    parameters: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Lesson:
    """A session that each participant teaches alone."""

    level: str
    """In XSB."""
    level_name: str
    starts: str
    episodes: int
    window: Window


class QuestionKind(Enum):
    """How a question is answered."""

    CHOICE = "choice"
    """One of `choices`."""
    SCALE = "scale"
    """A slider from `low` to `high`."""
    NUMBER = "number"
    """A number from `low` to `high`."""
    TEXT = "text"
    """Free text of at most 1,000 characters."""


Given = float | str | None
"""An answer to a question; None where it was left out."""
TEXT_LENGTH_MAX = 1000


@dataclass(frozen=True, slots=True)
class Question:
    """A question of the study's own, asked at the end. Raises: StudyError where it makes no sense."""

    name: str
    kind: QuestionKind
    text: str
    required: bool = True
    choices: tuple[str, ...] = ()
    low: float = 0.0
    high: float = 100.0
    step: float = 1.0
    low_label: str = ""
    high_label: str = ""

    def __post_init__(self) -> None:
        if (self.kind is QuestionKind.CHOICE) is not bool(self.choices):
            raise StudyError(f"question {self.name}: a choice has choices, and nothing else has")
        if not (self.low < self.high and self.step > 0):
            raise StudyError(f"question {self.name}: give low < high, and a step above 0")

    def takes(self, given: Given) -> bool:
        """Whether this is an answer to the question."""
        if given is None:
            return not self.required
        if self.kind is QuestionKind.CHOICE:
            return given in self.choices
        if self.kind is QuestionKind.TEXT:
            return isinstance(given, str) and len(given) <= TEXT_LENGTH_MAX
        return not isinstance(given, str) and self.low <= given <= self.high


@dataclass(frozen=True, slots=True)
class Study:
    """A study. Raises: StudyError where it makes no sense."""

    name: str
    title: str
    consent: Consent
    conditions: tuple[Condition, ...]
    teaching: Lesson
    practice: Lesson | None = None
    """None: nobody practises."""
    design: Design = Design.BETWEEN
    seed: int = 0
    """Of the assignment and of the worlds."""
    effort: bool = True
    """Whether people are asked for their effort after each lesson (NASA-TLX)."""
    questions: tuple[Question, ...] = ()
    """Asked of everybody at the end."""
    recruiter: Recruiter = Recruiter.NONE
    completion_code: str = ""
    """The same for everybody; empty: each person gets one of their own."""

    def __post_init__(self) -> None:
        if not self.consent.text.strip() or not self.consent.version.strip():
            raise StudyError("consent has no text or no version: write what people agree to, and number it")
        if not 1 <= len(self.conditions) <= CONDITIONS_MAX:
            raise StudyError(f"{len(self.conditions)} conditions: give 1 to {CONDITIONS_MAX}")
        names = [condition.name for condition in self.conditions]
        if len(set(names)) < len(names):
            raise StudyError(f"conditions {', '.join(names)}: give each a name of its own")
        if self.recruiter is Recruiter.PROLIFIC and not self.completion_code:
            raise StudyError("recruiter prolific: give the completion_code that Prolific shows for the study")
        asked = [question.name for question in self.questions]
        if len(set(asked)) < len(asked) or "participant" in asked:
            raise StudyError(f"questions {', '.join(asked)}: give each a name of its own, none participant")
        if not 1 <= len(self.name) <= NAME_LENGTH_MAX:
            raise StudyError(f"study name {self.name!r}: give 1 to {NAME_LENGTH_MAX} characters")

    @property
    def periods(self) -> int:
        """Return how many conditions one person meets."""
        return len(self.conditions) if self.design is Design.WITHIN else 1

    def lesson(self, period: int) -> Lesson:
        """Return what is taught in a period; 0 is practice."""
        return self.teaching if period or self.practice is None else self.practice

    def session(self, pseudonym: str, period: int) -> str:
        """Return the name of a person's session; period 0 is practice."""
        return f"{self.name}-{pseudonym}-{period}"
