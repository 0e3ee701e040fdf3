"""A journal's rows as the messages that a learner published when it wrote them: the same order and content.

Whoever missed a session, or part of it, learns from this what everybody else heard.
"""

from protocol.codec import DecodeError, DecodeFault, decode, printable
from protocol.journal import Kind, Record, events_of
from protocol.messages import CreateSession, Decision, Episode, Step
from protocol.translate import (
    UnknownAction,
    action_names,
    config_of,
    decision_message,
    episode_message,
    step_message,
)
from sfid_core.session.effects import Announce, Effect, EpisodeDone, StepDone
from sfid_core.session.events import Restarted
from sfid_core.session.machine import advance
from sfid_core.session.state import Session, new_session

Told = tuple[int, Decision | Step | Episode]
"""When the learner said it, ns since 1970, and the message."""

_UNTOLD = {Kind.DIGEST.value, Kind.CONFLICT.value}


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
