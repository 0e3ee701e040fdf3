"""A study as one TOML file."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

from services.runtime.schema_fault import in_words
from sfid_core.learning.methods import method_parameters
from sfid_core.learning.parameters import ParameterError
from sfid_core.session.config import Window, WindowMode
from sfid_core.sokoban.board import Level
from sfid_core.sokoban.levels import LevelError
from sfid_core.sokoban.starts import Starts, WorldError
from sfid_core.study.definition import (
    Condition,
    Consent,
    Design,
    Lesson,
    Question,
    QuestionKind,
    Recruiter,
    Study,
)
from sfid_core.study.errors import StudyError

FindLevel = Callable[[str], tuple[str, Level]]
"""Returns title and level for what a file names; may raise errors of its own, one line each."""
Episodes = Annotated[int, Meta(ge=1, le=10_000)]
Paragraphs = Annotated[str, Meta(max_length=20_000)]
StudyName = Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,23}$")]
ConditionName = Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,47}$")]
E = TypeVar("E", Design, Recruiter, WindowMode, QuestionKind)


class _Consent(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    version: Annotated[str, Meta(min_length=1, max_length=48)]
    text: Paragraphs


class _Condition(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: ConditionName
    method: str
    teacher: Annotated[str, Meta(min_length=1, max_length=48)] = "people"
    instructions: Paragraphs = ""
    parameters: dict[str, float | str] = {}


class _Question(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: ConditionName
    kind: str
    text: Annotated[str, Meta(min_length=1, max_length=500)]
    required: bool = True
    choices: Annotated[list[Annotated[str, Meta(min_length=1, max_length=120)]], Meta(max_length=30)] = []
    low: float = 0.0
    high: float = 100.0
    step: float = 1.0
    low_label: str = ""
    high_label: str = ""


class _Lesson(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    level: str = "room"
    starts: str = "4"
    episodes: Episodes = 10
    window: str = "until-answered"
    window_ms: Annotated[int, Meta(ge=1, le=3_600_000)] = 5_000


class _Page(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    listen: str = "127.0.0.1:7480"
    url: str | None = None
    tls_cert: str | None = None
    tls_key: str | None = None
    insecure_bind: bool = False


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: StudyName
    consent: _Consent
    conditions: list[_Condition]
    title: Annotated[str, Meta(max_length=120)] = "Teach an agent"
    design: str = "between"
    seed: Annotated[int, Meta(ge=0, le=2**53 - 1)] = 0
    effort: bool = True
    people: Annotated[int, Meta(ge=1, le=100_000)] = 100
    days: Annotated[float, Meta(gt=0, le=366)] = 30.0
    recruiter: str = "none"
    completion_code: Annotated[str, Meta(pattern=r"^[A-Za-z0-9-]{0,32}$")] = ""
    data: str = "sfid-data/study"
    questions: Annotated[list[_Question], Meta(max_length=40)] = []
    practice: _Lesson | None = None
    teaching: _Lesson = _Lesson()
    page: _Page = _Page()


@dataclass(frozen=True, slots=True)
class StudyFile:
    """What a file says: the study itself, and how it is run."""

    study: Study
    data: Path
    people: int
    """For how many the link is good."""
    days: float
    """How long it is good."""
    page: _Page

    @property
    def unfinished(self) -> str:
        """What is still to be written before people are asked, or nothing."""
        return PLACEHOLDER if PLACEHOLDER in self.study.consent.text else ""


def read_study(path: Path, find_level: FindLevel) -> StudyFile:
    """Return the study in a file. Raises StudyError: one line, what is wrong, where, and the mend."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
        file = msgspec.convert(document, _File)
    except OSError as error:
        raise StudyError(
            f"{path}: {error.strerror or error}: `sfid study new {path.name}` writes one"
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StudyError(f"{path}: not TOML: {error}: mend that line") from None
    except msgspec.ValidationError as error:
        said = f"{path}: {in_words(str(error))}"
        raise StudyError(f"{said}; `sfid study new` writes a file with every key") from None
    try:
        study = _study(file, find_level)
    except (StudyError, ParameterError, WorldError, LevelError) as error:
        raise StudyError(f"{path}: {error}") from None
    return StudyFile(study, Path(file.data), file.people, file.days, file.page)


def _study(file: _File, find_level: FindLevel) -> Study:
    for condition in file.conditions:
        method_parameters(condition.method, condition.parameters)
    lesson = partial(_lesson, find_level=find_level)
    return Study(
        name=file.name,
        title=file.title,
        consent=Consent(file.consent.version, file.consent.text.strip()),
        conditions=tuple(
            Condition(one.name, one.method, one.teacher, one.instructions.strip(), one.parameters)
            for one in file.conditions
        ),
        teaching=lesson(file.teaching),
        practice=None if file.practice is None else lesson(file.practice),
        design=_named(Design, file.design, "design"),
        seed=file.seed,
        effort=file.effort,
        questions=tuple(_question(one) for one in file.questions),
        recruiter=_named(Recruiter, file.recruiter, "recruiter"),
        completion_code=file.completion_code,
    )


def _question(given: _Question) -> Question:
    fields = msgspec.structs.asdict(given)
    return Question(
        **fields | {"kind": _named(QuestionKind, given.kind, "kind"), "choices": tuple(given.choices)}
    )


def _lesson(given: _Lesson, find_level: FindLevel) -> Lesson:
    Starts.parse(given.starts)
    title, level = find_level(given.level)
    window = Window(_named(WindowMode, given.window, "window"), given.window_ms)
    return Lesson(level.to_xsb(), title, given.starts, given.episodes, window)


def _named(kind: type[E], value: str, key: str) -> E:
    try:
        return kind(value)
    except ValueError:
        known = ", ".join(one.value for one in kind)
        raise StudyError(f"{key} {value!r} is unknown: choose one of {known}") from None


PLACEHOLDER = "WRITE A NAME AND AN ADDRESS HERE"
"""Whom participants can ask: a consent that still says this is nobody's."""
TEMPLATE = '''\
# A study with people. `sfid study run` starts it and prints the participants' link.
name = "NAME"                    # of the study: a-z, 0-9, - and _, at most 24
title = "Teach an agent"         # what participants read at the top
design = "between"               # between: everybody one condition; within: everybody all of them
seed = 1                         # of the assignment and of the worlds
people = 100                     # how many may use the link
days = 30                        # how long it is good
recruiter = "none"               # none, prolific or mturk: which parameters of the address are kept
completion_code = ""             # the same for everybody (Prolific); empty: each person gets their own
effort = true                    # ask for the effort after each lesson (six scales after NASA-TLX)
data = "sfid-data/NAME"          # directory of everything that is kept

[consent]
version = "1"                    # raise it whenever the text changes: the data says who agreed to which
text = """
You are invited to take part in a study on how people teach a computer program. You will teach it to push
boxes onto goals, for about ten minutes, and then say how much effort it was.

What you answer, and when, is stored under a random name. It is used for research and may be published without
anything that says who you are.

Taking part is voluntary. You can stop at any moment, without giving a reason, and have your answers deleted.

Questions: PLACEHOLDER.
"""

[[conditions]]                   # 1 to 8 of them; the first is what the others are compared with
name = "labels"
method = "sfid"                  # you say which way you would go
teacher = "people"               # a second factor, where there is one (expert, naive)
instructions = ""                # what is read before teaching; empty: our words for the method

[[conditions]]
name = "rewards"
method = "reward"                # you praise or blame what the agent did

[practice]                       # leave this table out: nobody practises
level = "classroom:0"
starts = "1"
episodes = 1

[teaching]
level = "room"                   # a packaged level (`sfid levels list`) or FILE[:N] in XSB
starts = "4"
episodes = 10
window = "until-answered"        # until-answered waits for people; early and full close after window_ms
window_ms = 5000

# [[questions]]                  # asked at the end, as many as you need
# name = "age"
# kind = "number"                # choice (with choices), scale, number or text
# text = "How old are you?"
# low = 18
# high = 120
# required = false

[page]
listen = "127.0.0.1:7480"        # HOST:PORT of the page
# url = "https://study.example"  # the address participants use, where it is another (behind a proxy)
# tls_cert = "cert.pem"          # needed where other machines reach it
# tls_key = "key.pem"
'''


def template(name: str) -> str:
    """Return the text of a new file."""
    text = TEMPLATE.replace("NAME", name, 1).replace("sfid-data/NAME", f"sfid-data/{name}")
    return text.replace("PLACEHOLDER", PLACEHOLDER)
