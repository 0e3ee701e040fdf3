"""A journal replayed under another method: the recorded steps and answers, learnt from in another way."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from protocol.codec import decode
from protocol.journal import Kind, Record, events_of
from protocol.messages import CreateSession, GymWorld
from protocol.translate import action_names, config_of
from services.runtime.journal import read_rows
from sfid_core.experiments.batch import world_of
from sfid_core.experiments.onlooker import greedy_success, watched_session
from sfid_core.learning.learner import Learner
from sfid_core.learning.methods import method_parameters
from sfid_core.learning.parameters import ParameterError, Value
from sfid_core.session.config import SessionConfig, WorldSpec
from sfid_core.session.machine import advance
from sfid_core.sokoban.live import WorldTables, tabulate
from sfid_core.sokoban.world import WorldError


@dataclass(frozen=True, slots=True)
class Lesson:
    """What one method learnt from a session."""

    method: str
    q_sha256: str
    states: int
    """States learnt about."""
    success: float | None
    """Share of the level's solvable states that the policy alone solves; None for a level too large."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """A session that another method cannot learn from, and why, in one line with the mend."""

    session: str
    reason: str


@dataclass(frozen=True, slots=True)
class OtherMethod:
    """What a session's recorded steps and answers come to under its own method and another."""

    session: str
    decisions: int
    answers: int
    recorded: Lesson
    other: Lesson


def replay_with(
    data_dir: Path, method: str, given: Mapping[str, Value], session: str | None = None
) -> list[OtherMethod | Misfit]:
    """Return every session (or the one named) of a data directory under another method, by name.

    The other method does not choose: it learns from steps that the recorded one took. A session whose answers
    it does not live on, or in which its parameters make no sense, is a misfit.
    Raises: ParameterError for an unknown method or parameters that it does not have, JournalError,
    DecodeError.
    """
    method_parameters(method, given)
    records: dict[str, list[Record]] = defaultdict(list)
    for row in read_rows(data_dir, session):
        if row.body is not None:
            records[row.session].append(Record(row.kind, row.at_ns, row.body))
    created = {name: rows for name, rows in records.items() if rows[0].kind == Kind.CREATED.value}
    return [_replayed_or_misfit(name, rows, method, given) for name, rows in sorted(created.items())]


def _replayed_or_misfit(
    name: str, records: list[Record], method: str, given: Mapping[str, Value]
) -> OtherMethod | Misfit:
    try:
        return _replayed(name, records, method, given)
    except ParameterError as error:
        return Misfit(name, str(error))


def _replayed(name: str, records: list[Record], method: str, given: Mapping[str, Value]) -> OtherMethod:
    message = decode(records[0].body, CreateSession)
    if isinstance(message.world, GymWorld):
        raise ParameterError(
            f"taught in {message.world.level_name}: other methods are judged on levels alone"
        )
    actions = action_names(message.world)
    numbers = {action: number for number, action in enumerate(actions)}
    config = config_of(message)
    watched = watched_session(config, method, given, len(actions))
    session = watched.session
    for record in records[1:]:
        for at_ns, event in events_of(record, numbers):
            session, _ = advance(session, at_ns, event)
    tables = _tables(config)
    return OtherMethod(
        name,
        session.decision,
        session.counts.applied,
        _lesson(config.method, session.learner, tables, config),
        _lesson(method, watched.onlooker, tables, config),
    )


def _lesson(method: str, learner: Learner, tables: WorldTables | None, config: SessionConfig) -> Lesson:
    digest, states = learner.sha256(), len(learner)
    success = None
    if tables is not None:
        success = greedy_success(learner, tables, config.seed, config.world.steps_max)
    return Lesson(method, digest, states, success)


def _tables(config: SessionConfig) -> WorldTables | None:
    world = WorldSpec(config.world.level, starts="all", steps_max=config.world.steps_max)
    try:
        return tabulate(world_of(SessionConfig(config.session, world)))
    except WorldError:
        return None
