"""The learner on its loop: journal, advance, perform, and acknowledge after the commit."""

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from protocol.codec import encode
from protocol.journal import Kind, digest_body, event_body, step_body
from protocol.keys import KeyNameError, Keys
from protocol.messages import Decision, Wire
from protocol.translate import decision_message, episode_message, step_message
from services.learner.config import LearnerConfig
from services.learner.doors import Doors
from services.learner.live import LiveSession, recovered
from services.learner.office import Office
from services.learner.ownership import agree_on_shards, shard_of
from services.learner.reception import Reception
from services.learner.recovery import Recovery
from services.learner.standing import Standing
from services.learner.world import WorldDesk
from services.runtime.bus import Bus, Presence
from services.runtime.clock import Clock
from services.runtime.durable_loop import DurableLoop, LoopSettings
from services.runtime.journal.shard import Shard, shard_directory
from services.runtime.journal.shards import gone, holds_journal
from sfid_core.session.effects import (
    Announce,
    BeginEpisode,
    Effect,
    EpisodeDone,
    Execute,
    SessionDone,
    StepDone,
)
from sfid_core.session.events import Event, Restarted, StepTaken, TeacherJoined, TeacherLeft, WindowElapsed
from sfid_core.session.machine import advance
from sfid_core.session.state import Phase

log = logging.getLogger("sfid.learner")


class Learner:
    """All sessions of one shard. Bus callbacks only enqueue; the rest happens on the thread of its loop."""

    def __init__(self, config: LearnerConfig, bus: Bus, shard: Shard, clock: Clock) -> None:
        self.config = config
        self.bus = bus
        self.shard = shard
        self.keys = Keys(config.deployment)
        self.sessions: dict[str, LiveSession] = {}
        settings = LoopSettings("learner", config.inbox_max, config.waiting_max, config.commit_every_ms)
        self.loop = DurableLoop(shard, clock, settings)
        self.world = WorldDesk(self)
        self.reception = Reception(self)
        self.office = Office(self)
        self.standing = Standing(self, clock)
        self.doors = Doors(self)

    # ------------------------------------------------------------ life

    def open(self, recovery: Recovery | None = None) -> None:
        """Rebuild every session, or go on where `recovery` is, and take up its thread; then serve.

        Raises: JournalError when a session cannot be read.
        """
        started_ns = self.loop.at_ns()
        for name, folded in (recovery or Recovery()).sessions(self.shard):
            self.sessions[name] = recovered(folded, self.keys)
        self.doors.open()
        for live in list(self.sessions.values()):
            if live.session.phase is not Phase.FINISHED:
                self.happen(live, Restarted(self.shard.epoch))
                log.info(
                    "session %s goes on at episode %d, decision %d, epoch %d (%.0f ms)",
                    live.name, live.session.episode, live.session.decision, self.shard.epoch,
                    (self.loop.at_ns() - started_ns) / 1e6,
                )  # fmt: skip
        before = frozenset(
            (live.name, name) for live in self.sessions.values() for name in live.session.teachers
        )
        self.loop.call_later(self.config.teachers_gone_ms, self._mark_gone, before)
        self.reception.desk.let_go(self._let_go)

    def owns(self, session: str) -> bool:
        """Tell whether a session of this name belongs to this shard, whether there is one or not."""
        shards = self.config.shards
        return shards == 1 or shard_of(session, shards) == self.config.shard

    def take_in(self, live: LiveSession) -> None:
        """Have a new session."""
        self.sessions[live.name] = live
        self.doors.open_session(live.name)

    def run(self, stop: threading.Event) -> None:
        """Turn until `stop` is set, then drain: nothing that was acknowledged waits in memory afterwards."""
        self.loop.run(stop)
        for live in self.sessions.values():
            self.note_digest(live)
        self.loop.commit()
        log.info("learner drained: %d sessions", len(self.sessions))

    def _on_window(self, live: LiveSession) -> None:
        deadline_ns = live.session.deadline_ns
        if deadline_ns is not None and deadline_ns <= self.loop.at_ns():
            self.happen(live, WindowElapsed())

    # ------------------------------------------------------------ events

    def happen(self, live: LiveSession, event: Event) -> tuple[Effect, ...]:
        """Journal an event that is no answer, advance the session, perform the effects."""
        at_ns = self.loop.at_ns()
        self._journal_event(live, at_ns, event)
        _, effects = advance(live.session, at_ns, event)
        self.perform(live, at_ns, effects)
        return effects

    def _journal_event(self, live: LiveSession, at_ns: int, event: Event) -> None:
        if isinstance(event, WindowElapsed):
            live.elapsed_at_ns = at_ns
        elif isinstance(event, StepTaken):
            self.append(live, Kind.STEP, step_body(event, live.elapsed_at_ns), at_ns)
            live.elapsed_at_ns = None
        else:
            self.journal_elapsed(live)
            kind, body = event_body(event)
            self.append(live, kind, body, at_ns)

    def journal_elapsed(self, live: LiveSession) -> None:
        """Journal a closing by the clock by itself, because something else than its step comes next."""
        if live.elapsed_at_ns is not None:
            self.append(live, Kind.ELAPSED, b"", live.elapsed_at_ns)
            live.elapsed_at_ns = None

    def append(
        self,
        live: LiveSession,
        kind: Kind,
        body: bytes,
        at_ns: int,
        unique: bytes | None = None,
        person: str | None = None,
    ) -> int:
        """Append a row to the open group and return its number; it is durable after the next commit."""
        return self.loop.append(live.name, kind.value, body, at_ns, unique, person)

    def perform(self, live: LiveSession, at_ns: int, effects: tuple[Effect, ...]) -> None:
        """Carry out effects: what the round waits for first, what only watchers see last.

        The decision is published once, as it stands after all of them.
        """
        announce = False
        for effect in effects:
            match effect:
                case Execute():
                    self.world.execute(live)
                case BeginEpisode():
                    self.world.begin(live)
                case Announce():
                    announce = True
        if announce:
            self.publish_decision(live, at_ns)
        self._tell_watchers(live, at_ns, effects)
        self._set_timer(live, live.session.deadline_ns)

    def _set_timer(self, live: LiveSession, deadline_ns: int | None) -> None:
        """Wait for the deadline, also for one that was given up in the meantime and has come back."""
        if deadline_ns is not None and deadline_ns != live.timer_ns:
            self.loop.call_at(deadline_ns, self._on_window, live)
        live.timer_ns = deadline_ns

    def _tell_watchers(self, live: LiveSession, at_ns: int, effects: tuple[Effect, ...]) -> None:
        for effect in effects:
            match effect:
                case StepDone(measures):
                    self._publish_measures(live, step_message(measures, live.session, live.actions, at_ns))
                case EpisodeDone(measures):
                    self._episode_done(live, at_ns, measures)
                case SessionDone():
                    self.note_digest(live)
                    text, episodes = "session %s finished after %d episodes", len(live.session.episodes)
                    # Whoever reads the journal of a finished session finds all of it.
                    self.loop.after_commit(partial(log.info, text, live.name, episodes))

    def _publish_measures(self, live: LiveSession, message: Wire) -> None:
        self.bus.publish(live.measures_key, encode(message))

    def _episode_done(self, live: LiveSession, at_ns: int, measures: Any) -> None:  # noqa: ANN401 - EpisodeMeasures
        self._publish_measures(live, episode_message(measures, live.session, at_ns))
        done = measures.episode + 1
        if done & (done - 1) == 0:  # 1, 2, 4, 8 ...: a growing table is hashed a bounded number of times
            self.note_digest(live)

    def publish_decision(self, live: LiveSession, at_ns: int) -> None:
        """Publish the decision as it stands."""
        live.sequence += 1
        self.bus.publish(live.decision_key, encode(self.decision(live, at_ns)))

    def decision(self, live: LiveSession, at_ns: int) -> Decision:
        """Return the decision as it stands."""
        return decision_message(live.session, live.actions, live.sequence, at_ns)

    def note_digest(self, live: LiveSession) -> None:
        """Journal the SHA-256 of the table as it stands."""
        self.journal_elapsed(live)
        body = digest_body(live.session, live.session.learner.sha256())
        self.append(live, Kind.DIGEST, body, self.loop.at_ns())

    # ------------------------------------------------------------ presence

    def on_presence(self, presence: Presence) -> None:
        """Note that somebody has come, or is gone."""
        try:
            session, teacher, run = self.keys.presence(presence.key)
        except KeyNameError:  # anybody may announce anything
            return
        if not self.owns(session):
            return
        live, roll, place = self.sessions.get(session), self.reception.desk.roll, (session, teacher)
        if presence.present:
            counts = roll.show(place, run)
            if live is None or not counts:
                return
            if self._comes_back(live, teacher):
                self.happen(live, TeacherJoined(teacher))
                log.info("session %s: teacher %s is back", session, teacher)
            if run and teacher in live.session.teachers:
                roll.let_in(place, run)
            return
        if roll.take_back(place, run) and live is not None and teacher in live.session.teachers:
            self.happen(live, TeacherLeft(teacher))
            log.info("session %s: teacher %s is gone", session, teacher)

    def _comes_back(self, live: LiveSession, teacher: str) -> bool:
        # Anybody may announce anything: where tokens are required, whoever comes back joins with theirs.
        away = live.session.phase is Phase.FINISHED or self.config.require_tokens
        return not away and teacher in live.known and teacher not in live.session.teachers

    def _let_go(self, session: str, teacher: str) -> None:
        """Wait no longer for somebody whose token is no longer good."""
        live = self.sessions.get(session)
        if live is not None and teacher in live.session.teachers and live.session.phase is not Phase.FINISHED:
            self.happen(live, TeacherLeft(teacher))
            log.info("session %s: the token of teacher %s is no longer good", session, teacher)

    def _mark_gone(self, expected: frozenset[tuple[str, str]]) -> None:
        """Let those go whose tokens are not there."""
        desk = self.reception.desk
        for name, teacher in sorted(place for place in expected if not desk.is_here(place)):
            desk.roll.forget((name, teacher))
            live = self.sessions[name]
            if teacher in live.session.teachers and live.session.phase is not Phase.FINISHED:
                self.happen(live, TeacherLeft(teacher))
                log.info("session %s: teacher %s shows no token", name, teacher)

    def expect_token(self, live: LiveSession, teacher: str) -> None:
        """Let a teacher who joined go again unless their token is there soon: else nobody sees them die."""
        expected = frozenset({(live.name, teacher)})
        self.loop.call_later(self.config.teachers_gone_ms, self._mark_gone, expected)


def run(
    config: LearnerConfig, bus: Bus, clock: Clock, ready: Callable[[], None], stop: threading.Event
) -> None:
    """Open the journal, take up every session and serve until `stop` is set."""
    agree_on_shards(config.data_dir, 1)
    with opened(config, bus, clock) as learner:
        ready()
        learner.run(stop)


@contextmanager
def opened(config: LearnerConfig, bus: Bus, clock: Clock) -> Iterator[Learner]:
    """Take the shard and every session of it up, and give them back at the end.

    Raises: JournalError, as `Shard.open`; also where the shard is gone, or a session cannot be read.
    """
    if config.shards > 1 and not holds_journal(shard_directory(config.data_dir, config.shard)):
        raise gone(config.data_dir, config.shard)
    recovery = Recovery()
    with Shard.open(config.data_dir, config.shard, recovery.begin) as shard:
        learner = Learner(config, bus, shard, clock)
        try:
            learner.open(recovery)
            yield learner
        finally:
            learner.doors.close()
