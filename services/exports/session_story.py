"""A session as its journal tells it: every answer, every executed step, every episode, in order."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from protocol.codec import decode
from protocol.journal import Record, events_of, read_answer_body
from protocol.messages import Answer, CreateSession
from protocol.translate import action_names, config_of, named
from protocol.world_messages import UNDO
from services.exports.table import ExportError
from services.runtime.journal import Row, read_rows
from sfid_core.session.effects import EpisodeDone, StepDone
from sfid_core.session.events import AnswerGiven, TeacherJoined, TeacherLeft
from sfid_core.session.machine import advance
from sfid_core.session.measures import EpisodeMeasures, StepMeasures
from sfid_core.session.state import Phase, Session, new_session
from sfid_core.teaching.answers import Answer as Said
from sfid_core.teaching.answers import AnswerKind


@dataclass(slots=True)
class AnswerRow:
    """One answer as it came."""

    seq: int
    at_ns: int
    message: Answer
    said: Said
    code: str
    reason: str
    latency_ms: float | None
    """From the opening of its window to its arrival, by the learner's clock; None when that was over."""
    applied: bool = False


class StepRow(NamedTuple):
    """One executed step, and what was learnt from it."""

    at_ns: int
    measures: StepMeasures
    action: str
    next_state: bytes


class EpisodeRow(NamedTuple):
    """A finished episode."""

    at_ns: int
    decision: int
    """The decision after it."""
    measures: EpisodeMeasures
    q_sha256: str
    """SHA-256 of what was learnt until then."""


class PresenceRow(NamedTuple):
    """A teacher came or went."""

    at_ns: int
    decision: int
    teacher: str
    event: str


@dataclass(slots=True)
class Story:
    """Everything that was journaled about one session."""

    config: CreateSession
    created_ns: int
    actions: tuple[str, ...]
    session: Session
    answers: list[AnswerRow] = field(default_factory=list)
    steps: list[StepRow] = field(default_factory=list)
    episodes: list[EpisodeRow] = field(default_factory=list)
    presence: list[PresenceRow] = field(default_factory=list)
    erased: int = 0
    """Rows whose content was erased for good."""

    def by_episode(self) -> dict[int, list[StepRow]]:
        """Return the steps of each finished episode by its number, those taken back among them."""
        found: dict[int, list[StepRow]] = {each.measures.episode: [] for each in self.episodes}
        for row in self.steps:
            if row.measures.episode in found:
                found[row.measures.episode].append(row)
        return found


def read_story(data_dir: Path, session: str) -> Story:
    """Return a session's story.

    Raises: ExportError when there is no such session; JournalError or DecodeError when it cannot be read.
    """
    story = tell_story(read_rows(data_dir, session))
    if story is None:
        raise ExportError(f"no session {session} in {data_dir}: `sfid replay {data_dir}` lists what there is")
    return story


def tell_story(rows: Iterable[Row]) -> Story | None:
    """Return the story of one session's rows; None without any."""
    teller: _Teller | None = None
    for row in rows:
        if row.body is None:
            if teller is not None:
                teller.story.erased += 1
        elif teller is None:
            teller = _Teller(row.at_ns, decode(row.body, CreateSession))
        else:
            teller.tell(row, row.body)
    return None if teller is None else teller.story


class _Teller:
    """Advances the session row by row and notes what happens."""

    def __init__(self, at_ns: int, config: CreateSession) -> None:
        actions = action_names(config.world)
        self._numbers = {name: index for index, name in enumerate(actions)}
        self.story = Story(config, at_ns, actions, new_session(config_of(config), len(actions)))
        self._waiting: list[AnswerRow] = []
        """Answers since the last executed step."""

    def tell(self, row: Row, body: bytes) -> None:
        story, session = self.story, self.story.session
        for at_ns, event in events_of(Record(row.kind, row.at_ns, body), self._numbers):
            if isinstance(event, TeacherJoined | TeacherLeft):
                what = "joined" if isinstance(event, TeacherJoined) else "left"
                story.presence.append(PresenceRow(at_ns, session.decision, event.teacher, what))
            elif isinstance(event, AnswerGiven):
                self._answered(row, body, event)
            _, effects = advance(session, at_ns, event)
            for effect in effects:
                if isinstance(effect, StepDone):
                    self._stepped(at_ns, effect.measures)
                elif isinstance(effect, EpisodeDone):
                    digest = session.learner.sha256()
                    story.episodes.append(EpisodeRow(at_ns, session.decision, effect.measures, digest))

    def _answered(self, row: Row, body: bytes, event: AnswerGiven) -> None:
        session = self.story.session
        code, reason, payload = read_answer_body(body)
        asking = session.phase is Phase.ASKING and event.decision == session.decision
        latency = (row.at_ns - session.asked_at_ns) / 1e6 if asking else None
        noted = AnswerRow(
            row.seq, row.at_ns, decode(payload, Answer), event.answer, code.value, reason, latency
        )
        self.story.answers.append(noted)
        self._waiting.append(noted)

    def _stepped(self, at_ns: int, measures: StepMeasures) -> None:
        counted = list(measures.answers)
        for row in reversed(self._waiting):  # of several by one teacher the last one counts
            pair = (row.message.teacher, row.said)
            if row.code == "accepted" and pair in counted:
                counted.remove(pair)
                row.applied = row.said.kind is not AnswerKind.ABSTAIN
        self._waiting.clear()
        story = self.story
        action = named(measures.action, story.actions)
        story.steps.append(StepRow(at_ns, measures, action, story.session.state))


def kept_steps(steps: Sequence[StepRow]) -> list[StepRow]:
    """Return the steps of an episode that stand in the end.

    UNDO goes back to before the action before it; taking back what was taken back puts it into force
    again, as the environment does.
    """
    now: tuple[StepRow, ...] = ()
    before: tuple[StepRow, ...] = ()
    for row in steps:
        now, before = (before, now) if row.action == UNDO else ((*now, row), now)
    return list(now)
