"""Sessions and events for tests: made short, so that a test shows only what it is about."""

from collections.abc import Iterable, Sequence
from copy import deepcopy
from dataclasses import fields
from typing import Any

from sfid_core.outcome import Outcome
from sfid_core.session.config import SessionConfig, Window, WindowMode, WorldSpec
from sfid_core.session.effects import Effect
from sfid_core.session.events import (
    AnswerGiven,
    EpisodeBegan,
    Event,
    Paused,
    StepTaken,
    Stopped,
    TeacherJoined,
)
from sfid_core.session.machine import advance
from sfid_core.session.state import Phase, Session, new_session
from sfid_core.teaching.answers import Answer, AnswerKind

MS = 1_000_000
STATES = tuple(b"state %d" % number for number in range(8))
VIEWS = tuple(f"view {number}" for number in range(8))
EARLY = Window(WindowMode.EARLY, 1000)
FULL = Window(WindowMode.FULL, 1000)
PATIENT = Window(WindowMode.UNTIL_ANSWERED, 1000)


def configured(
    method: str = "sfid", window: Window = EARLY, episodes: int = 2, teachers_min: int = 1, seed: int = 7
) -> SessionConfig:
    return SessionConfig(
        "lab", WorldSpec(""), method, episodes=episodes, seed=seed, window=window, teachers_min=teachers_min
    )


def answer_id(number: int) -> bytes:
    return number.to_bytes(16, "big")


def label(
    teacher: str, action: int, decision: int = 0, state: bytes = STATES[0], number: int = 0
) -> AnswerGiven:
    return AnswerGiven(teacher, answer_id(number), decision, state, Answer(AnswerKind.LABEL, action=action))


def praise(
    teacher: str, reward: float, decision: int = 0, state: bytes = STATES[0], number: int = 0
) -> AnswerGiven:
    return AnswerGiven(teacher, answer_id(number), decision, state, Answer(AnswerKind.REWARD, reward=reward))


def abstention(teacher: str, decision: int = 0, state: bytes = STATES[0], number: int = 0) -> AnswerGiven:
    return AnswerGiven(teacher, answer_id(number), decision, state, Answer(AnswerKind.ABSTAIN))


def taken(
    decision: int = 0, reward: float = 0.0, outcome: Outcome = Outcome.RUNNING, number: int = 1
) -> StepTaken:
    return StepTaken(decision, reward, outcome, STATES[number], VIEWS[number])


def began(episode: int = 0) -> EpisodeBegan:
    return EpisodeBegan(episode, STATES[0], VIEWS[0], 3)


def play(session: Session, events: Iterable[tuple[int, Event]]) -> list[tuple[Effect, ...]]:
    """Advance through (at_ms, event) and return the effects of each."""
    played = []
    for at_ms, event in events:
        _, effects = advance(session, at_ms * MS, event)
        played.append(effects)
    return played


def asked(
    method: str = "sfid", window: Window = EARLY, teachers: Sequence[str] = ("ann",), episodes: int = 2
) -> Session:
    """A session whose first decision opened at 0 ms: labels are asked, rewards are not yet."""
    session = new_session(configured(method, window, episodes, len(teachers)))
    play(session, [*((0, TeacherJoined(teacher)) for teacher in teachers), (0, began())])
    return session


def in_phase(phase: Phase, method: str) -> Session:
    """A session with the teacher ann in this phase; its first decision, if any, opened at 0 ms."""
    if phase is Phase.GATHERING:
        return new_session(configured(method, teachers_min=2))
    session = new_session(configured(method))
    play(session, [(0, TeacherJoined("ann"))])
    if phase is Phase.BEGINNING:
        return session
    if phase is Phase.READY:
        play(session, [(0, Paused("ann")), (0, began())])
    else:
        play(session, [(0, began())])
    if phase is Phase.FINISHED:
        play(session, [(0, Stopped("ann"))])
    if phase is Phase.ASKING and method == "reward":
        play(session, [(0, taken())])
    if phase is Phase.EXECUTING and method == "sfid":
        play(session, [(0, label("ann", 0, number=99))])
    assert session.phase is phase
    return session


def snapshot(session: Session) -> dict[str, Any]:
    """Everything that a session holds, as values that compare."""
    held = {field.name: getattr(session, field.name) for field in fields(session)}
    held["learner"] = session.learner.sha256()
    held["tally"] = session.tally.measures(0, None, Outcome.RUNNING)
    return deepcopy(held)
