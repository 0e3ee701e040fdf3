"""A journal's rows as the messages that a learner published when it wrote them: the same order and content.

Whoever missed a session, or part of it, learns from this what everybody else heard.
"""

from collections.abc import Iterable, Iterator

from protocol.codec import DecodeError, DecodeFault, decode, printable
from protocol.crowd_journal import ClosedRow, CrowdKind, FoldedCrowd, apply_row, fold_crowd, read_body
from protocol.crowd_message import Crowd, WorkerReliability
from protocol.journal import Kind, Record, events_of, read_answer_body
from protocol.messages import Answer, CreateSession, Decision, Episode, Step
from protocol.translate import (
    UnknownAction,
    action_names,
    config_of,
    decision_message,
    episode_message,
    step_message,
)
from sfid_core.crowd.tally import Reliability
from sfid_core.session.effects import Announce, Effect, EpisodeDone, StepDone
from sfid_core.session.events import Restarted
from sfid_core.session.machine import advance
from sfid_core.session.state import Session, new_session
from sfid_core.teaching.answers import AnswerKind

Told = tuple[int, Decision | Step | Episode]
"""When the learner said it, ns since 1970, and the message."""

WORKERS_MAX = 256
"""Workers in one report, who answered last first."""
_UNTOLD = {Kind.DIGEST.value, Kind.CONFLICT.value, Kind.BRANCHED.value}


class Retelling:
    """One session told anew, row by row in the order of its journal; the first row creates it."""

    def __init__(self) -> None:
        self.config: CreateSession | None = None
        self._session: Session | None = None
        self._actions: tuple[str, ...] = ()
        self._numbers: dict[str, int] = {}
        self._sequence = 0

    def tell(self, record: Record) -> list[Told]:
        """Return what the learner published for this row; raise DecodeError when it cannot be read."""
        if self._session is None:
            self.config = decode(record.body, CreateSession)
            self._actions = action_names(self.config.world)
            self._numbers = {name: index for index, name in enumerate(self._actions)}
            self._session = new_session(config_of(self.config), len(self._actions))
            return []
        if record.kind in _UNTOLD:
            return []
        told: list[Told] = []
        try:
            for at_ns, event in events_of(record, self._numbers):
                if isinstance(event, Restarted):
                    self._sequence = 0
                _, effects = advance(self._session, at_ns, event)
                told += self._messages(self._session, at_ns, effects)
        except (UnknownAction, ValueError, TypeError, IndexError) as error:
            if isinstance(error, DecodeError):
                raise
            detail = f"{record.kind} row: {printable(str(error))}"
            raise DecodeError(DecodeFault.NOT_THE_SCHEMA, detail) from None
        return told

    def _messages(self, session: Session, at_ns: int, effects: tuple[Effect, ...]) -> list[Told]:
        """The decision first, once, as it stands after all effects; then what only watchers hear."""
        told: list[Told] = []
        if any(isinstance(effect, Announce) for effect in effects):
            self._sequence += 1
            told.append((at_ns, decision_message(session, self._actions, self._sequence, at_ns)))
        for effect in effects:
            if isinstance(effect, StepDone):
                told.append((at_ns, step_message(effect.measures, session, self._actions, at_ns)))
            elif isinstance(effect, EpisodeDone):
                told.append((at_ns, episode_message(effect.measures, session, at_ns)))
        return told


def retold_crowd(records: Iterable[Record], session: str) -> Iterator[Crowd]:
    """Yield what an aggregator knew of its workers after each round that it learnt from.

    A live aggregator publishes the latest of these once a second at most.
    Raises: DecodeError when a row cannot be read.
    """
    folded: FoldedCrowd | None = None
    numbers: dict[str, int] = {}
    answered: dict[str, None] = {}
    for record in records:
        if folded is None:
            folded = fold_crowd([record])
            if folded is not None:
                numbers = {name: index for index, name in enumerate(folded.config.actions)}
            continue
        before = folded.crowd.conclusions
        if record.kind == CrowdKind.ANSWER.value:
            worker = decode(read_answer_body(record.body)[2], Answer).teacher
            answered.pop(worker, None)
            answered[worker] = None
        apply_row(folded, record, numbers)
        if folded.crowd.conclusions > before:
            yield _crowd(folded, record, session, tuple(reversed(answered)))


def _crowd(folded: FoldedCrowd, closing: Record, session: str, workers: tuple[str, ...]) -> Crowd:
    row = read_body(closing.kind, closing.body, ClosedRow)
    handed = decode(row.handed, Answer) if row.handed else None
    asked = folded.asked
    told: list[tuple[str, Reliability]] = []
    if asked is not None:
        known = folded.crowd.aggregate(AnswerKind(asked.asked))
        told = [(name, known.reliability(name)) for name in workers[:WORKERS_MAX]]
    return Crowd(
        session=session,
        aggregator=folded.config.aggregator,
        epoch=0 if asked is None else asked.epoch,
        decision=row.decision,
        at_ns=closing.at_ns,
        cause=row.cause,  # type: ignore[arg-type]
        members=len(folded.crowd.members),
        answered=row.answered,
        action=None if handed is None else handed.action,
        posterior=None if handed is None else handed.posterior,
        conclusions=folded.crowd.conclusions,
        too_late=0,
        workers=tuple(
            WorkerReliability(
                worker=name,
                mean=each.mean,
                standard_error=each.standard_error,
                labels=each.labels,
                standing=each.standing.value,
                present=name in folded.crowd.members,
            )
            for name, each in told
        ),
    )
