"""The monitor's one worker: decodes what came, keeps the sessions' views, hands their rows on."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

from protocol.codec import DecodeError, decode, encode, printable
from protocol.keys import Keys
from protocol.messages import (
    Decision,
    Episode,
    SessionList,
    SessionQuery,
    SessionReport,
    SessionSummary,
    Step,
)
from services.monitor.config import MonitorConfig
from services.monitor.inbox import Inbox, Listed, Shown
from services.monitor.live import Live
from services.monitor.recordings import Recording
from services.monitor.rows import Rows
from services.monitor.session_view import SessionView
from services.runtime.bus import Bus, Received
from services.runtime.clock import Clock

IDLE_S = 0.05
"""Longest wait for a message: half the scene's period, so that a frame is at most that late."""
ASK_TIMEOUT_MS = 3_000
REPORT_EPISODES_MAX = 100

_LOG = logging.getLogger(__name__)


@dataclass(slots=True)
class MonitorCounts:
    """What the monitor did; returned by `run`."""

    messages: int = 0
    malformed: int = 0
    unreadable_views: int = 0
    pictures: int = 0
    dropped_messages: int = 0
    dropped_rows: int = 0


@dataclass(slots=True)
class _Watched:
    """One session that is shown."""

    view: SessionView
    recording: Recording | None
    recording_id: str
    heard_s: float
    asking: bool = False


class Worker:
    """Everything that happens on the worker's thread; `inbox` is the only way in."""

    def __init__(self, config: MonitorConfig, bus: Bus, live: Live | None, clock: Clock) -> None:
        self.inbox = Inbox()
        self.counts = MonitorCounts()
        self._config = config
        self._keys = Keys(config.deployment)
        self._bus = bus
        self._live = live
        self._clock = clock
        self._watched: dict[str, _Watched] = {}

    def subscribe(self) -> None:
        """Listen to the sessions, and ask the learner what happened before."""
        session = self._config.session or "*"
        self._bus.subscribe(self._keys.decision(session), self.inbox.put)
        self._bus.subscribe(self._keys.measures(session), self.inbox.put)
        if self._config.session is not None:
            self._watch(self._config.session)
            return
        query = encode(SessionQuery())
        self._bus.ask(
            self._keys.learner("list"),
            query,
            lambda reply: self.inbox.put_reply(Listed(reply)),
            ASK_TIMEOUT_MS,
        )

    def run(self, stopping: Callable[[], bool]) -> None:
        """Work until `stopping`, then show what is left and close the files."""
        try:
            while not stopping():
                self._round(IDLE_S)
            self._round(0.0)
        finally:
            self.close()

    def close(self) -> None:
        """End every recording well; safe to call again."""
        for session in list(self._watched):
            self._unwatch(session)
        self.counts.dropped_messages = self.inbox.dropped

    def _round(self, timeout_s: float) -> None:
        for item in self.inbox.take(timeout_s):
            match item:
                case Received():
                    self._take_message(item)
                case Listed():
                    self._take_list(item)
                case Shown():
                    self._take_report(item)
        now_s = self._now_s()
        active = sum(now_s - watched.heard_s < 1.0 for watched in self._watched.values())
        for watched in self._watched.values():
            self._show(watched, watched.view.tick(now_s, max(1, active)))

    def _take_message(self, received: Received) -> None:
        try:
            message = _decoded(received)
        except DecodeError as error:
            self._count_malformed(received.key, str(error))
            return
        expected = self._keys.decision if isinstance(message, Decision) else self._keys.measures
        if received.key != expected(message.session):
            self._count_malformed(received.key, "the message is of another session or kind than its key")
            return
        self.counts.messages += 1
        watched = self._watched.get(message.session) or self._watch(message.session)
        watched.heard_s = self._now_s()
        watched.view.take(message, self._clock.wall_ns())
        if watched.view.episodes.missing() is not None:
            self._ask(message.session, watched)

    def _count_malformed(self, key: str, detail: str) -> None:
        self.counts.malformed += 1
        if self.counts.malformed == 1:
            _LOG.warning(
                "a message on %s cannot be read and is skipped, as all like it: %s", printable(key), detail
            )
        session = key.removeprefix(f"{self._keys.root}/session/").split("/")[0]
        if (watched := self._watched.get(session)) is not None:
            watched.view.note(f"a message cannot be read and is skipped: {detail}", level="WARN")

    def _take_list(self, listed: Listed) -> None:
        if listed.reply is None or not listed.reply.ok:
            return
        try:
            sessions = decode(listed.reply.payload, SessionList).sessions
        except DecodeError as error:
            self._count_malformed(self._keys.learner("list"), str(error))
            return
        for summary in _worth_watching(sessions)[-self._config.sessions_max :]:
            if summary.session not in self._watched:
                self._watch(summary.session)

    def _take_report(self, shown: Shown) -> None:
        watched = self._watched.get(shown.session)
        if watched is None:
            return
        watched.asking = False
        wall_ns = self._clock.wall_ns()
        full_page = False
        if shown.reply is not None and shown.reply.ok:
            try:
                report = decode(shown.reply.payload, SessionReport)
            except DecodeError as error:
                self._count_malformed(self._keys.decision(shown.session), str(error))
            else:
                before = watched.view.episodes.expected()
                watched.view.take_report(report, wall_ns)
                full_page = (
                    len(report.episodes) >= REPORT_EPISODES_MAX and watched.view.episodes.expected() > before
                )
        if full_page:
            self._ask(shown.session, watched)
        elif watched.view.episodes.missing() is not None:
            watched.view.give_up_missing(wall_ns)

    def _ask(self, session: str, watched: _Watched) -> None:
        if watched.asking:
            return
        watched.asking = True
        query = SessionQuery(session=session, first_episode=watched.view.episodes.expected())
        self._bus.ask(
            self._keys.learner("show"),
            encode(query),
            lambda reply: self.inbox.put_reply(Shown(session, reply)),
            ASK_TIMEOUT_MS,
        )

    def _watch(self, session: str) -> _Watched:
        """Begin to show a session, in the place of the quietest when there are too many."""
        if len(self._watched) >= self._config.sessions_max:
            self._unwatch(min(self._watched, key=lambda name: self._watched[name].heard_s))
        now_s = self._now_s()
        recording_id = f"{self._config.deployment}-{session}"
        folder = self._config.recording_dir
        recording = None if folder is None else Recording(folder, session, recording_id)
        watched = _Watched(SessionView(now_s), recording, recording_id, now_s)
        self._watched[session] = watched
        self._ask(session, watched)
        return watched

    def _unwatch(self, session: str) -> None:
        watched = self._watched.pop(session)
        try:
            # Episodes that still wait for earlier ones are shown without them, rather than not at all.
            watched.view.give_up_missing(self._clock.wall_ns())
            self._show(watched, watched.view.flush(self._now_s()))
        finally:
            self.counts.unreadable_views += watched.view.unreadable_views
            if watched.recording is not None:
                watched.recording.close()
            if self._live is not None:
                self._live.forget(watched.recording_id)

    def _show(self, watched: _Watched, rows: Rows) -> None:
        self.counts.pictures += len(rows.scene)
        if watched.recording is not None:
            watched.recording.write(rows)
        if self._live is not None:
            self._live.show(watched.recording_id, rows)

    def _now_s(self) -> float:
        return self._clock.now_ns() / 1e9


def _decoded(received: Received) -> Decision | Step | Episode:
    # `decode` takes a union as well as a class, but a union has no type that says so.
    return decode(received.payload, cast("type[Decision]", Decision | Step | Episode))


def _worth_watching(sessions: tuple[SessionSummary, ...]) -> list[SessionSummary]:
    """The sessions that go on; where none does, the last one."""
    return [summary for summary in sessions if summary.phase != "finished"] or list(sessions[-1:])
