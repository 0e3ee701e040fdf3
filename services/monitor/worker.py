"""The monitor's one worker: decodes what came, keeps the sessions' views, hands their rows on."""

import itertools
import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, cast

from protocol.codec import DecodeError, decode, encode, printable
from protocol.crowd_message import Crowd
from protocol.keys import Keys
from protocol.messages import Decision, Episode, SessionQuery, SessionReport, SessionSummary, Step
from protocol.session_union import union
from services.monitor.config import MonitorConfig, MonitorError
from services.monitor.inbox import Asked, Inbox, Listed, Shown, Told
from services.monitor.live import Live
from services.monitor.overview import PERIOD_S, draw_overview, glance
from services.monitor.past import Past
from services.monitor.recordings import Recording, new_file
from services.monitor.rows import Rows
from services.monitor.session_view import Due, SessionView
from services.runtime.bus import Bus, Received
from services.runtime.clock import Clock
from services.runtime.status import StatusDesk

IDLE_S = 0.05
"""Longest wait for a message: half the scene's period, so that a frame is at most that late."""
ASK_TIMEOUT_MS = 3_000
REPORT_EPISODES_MAX = 100
LAST_ROUNDS = 8
"""Rounds after the stop at least: an answer that has just come may lead to one more question."""
LAST_S = 1.0
"""For how long the rest is worked off after the stop; what waits then is counted as dropped, and the files
are closed, for which a busy machine needs longer than this."""
HELD_MAX = 100
"""Batches of rows held back for viewers of a session that waits for its teachers: events, most of all."""
UNSHOWN_S = 60.0
"""For how long a session that is not shown counts as going on after its last message."""

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
    past: Past
    recording: Recording | None
    recording_id: str
    heard_s: float
    asking: bool = False
    held: deque[Rows] | None = field(default_factory=lambda: deque(maxlen=HELD_MAX))
    """What viewers have not been sent, because the session only waits; None once it is shown."""


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
        self._unshown: dict[str, float] = {}
        """Sessions that are heard but not shown, for want of room: when each was heard last, in s."""
        self._overview_due_s = 0.0
        self._desk = StatusDesk("monitor", "0", clock, self._facts)

    def _facts(self) -> dict[str, Any]:
        cut = 0 if self._live is None else self._live.cut
        refused = {"malformed": self.counts.malformed, "dropped": self.inbox.dropped, "viewers-cut": cut}
        return {
            "backlog": self.inbox.waiting,
            "sessions": len(self._watched),
            "running": sum(not each.view.is_finished for each in self._watched.values()),
            "refused": {reason: count for reason, count in refused.items() if count},
        }

    def subscribe(self) -> None:
        """Listen to the sessions, and ask the learner what happened before."""
        session = self._config.session or "*"
        self._bus.subscribe(self._keys.decision(session), self.inbox.put)
        self._bus.subscribe(self._keys.measures(session), self.inbox.put)
        self._bus.subscribe(self._keys.crowd(session), self.inbox.put)
        status = self._keys.status("monitor", "0")
        self._bus.serve(status, lambda request: self.inbox.put_reply(Asked(request)))
        self._bus.announce(self._keys.service("monitor", "0"))
        if self._config.session is not None:
            self._watch(self._config.session)
            return
        # The latest page only: it shows sixteen sessions, and an older one that goes on is heard anyway.
        query = encode(SessionQuery())
        self._bus.ask_all(
            self._keys.learner("list"),
            query,
            lambda replies: self.inbox.put_reply(Listed(replies)),
            ASK_TIMEOUT_MS,
        )

    def run(self, stopping: Callable[[], bool]) -> None:
        """Work until `stopping`, then show what is left and close the files."""
        try:
            while not stopping():
                self._round(IDLE_S)
            until_s = self._now_s() + LAST_S
            for number in itertools.count():
                if self._now_s() >= until_s or (number >= LAST_ROUNDS and not self.inbox.waiting):
                    break
                self._round(0.0)
        finally:
            self.close()
            if self.inbox.waiting:
                _LOG.warning("%d messages were not shown: stopped while much was said", self.inbox.waiting)

    def close(self) -> None:
        """End every recording well; safe to call again."""
        # Those held back first: they stay so while another is shown, and no viewer leaves that one for them.
        for session in sorted(self._watched, key=lambda name: self._watched[name].held is None):
            self._unwatch(session)
        self.counts.dropped_messages = self.inbox.dropped + self.inbox.waiting

    def _round(self, timeout_s: float) -> None:
        for item in self.inbox.take(timeout_s):
            match item:
                case Received():
                    self._take_message(item)
                case Listed():
                    self._take_list(item)
                case Shown():
                    self._take_report(item)
                case Told():
                    self._take_page(item)
                case Asked():
                    self._desk.reply(item.request)
        now_s = self._now_s()
        active = sum(now_s - watched.heard_s < 1.0 for watched in self._watched.values())
        pace = max(1, active) * (1 if self._live is None else self._live.pace)
        for watched in self._watched.values():
            self._show(watched, watched.view.tick(now_s, pace))
        self._show_overview(now_s, pace)

    def _show_overview(self, now_s: float, pace: int) -> None:
        """All sessions at a glance, for the viewers of each: whoever watches one sees the others."""
        if self._live is None or not self._watched or now_s < self._overview_due_s:
            return
        self._overview_due_s = now_s + PERIOD_S * pace
        glances = [glance(name, each.view, now_s) for name, each in sorted(self._watched.items())]
        self._unshown = {name: at_s for name, at_s in self._unshown.items() if now_s - at_s < UNSHOWN_S}
        for watched in (each for each in self._watched.values() if each.held is None):
            picture = draw_overview(glances, watched.view.chronicle.moment, len(self._unshown))
            self._live.show(watched.recording_id, Rows(curves=[picture]))

    def _take_message(self, received: Received) -> None:
        session = self._session_of(received.key)
        if session not in self._watched and not self._has_room():
            self._leave_out(session)
            return
        try:
            message = _decoded(received)
        except DecodeError as error:
            self._count_malformed(received.key, str(error))
            return
        if received.key != self._key_of(message):
            self._count_malformed(received.key, "the message is of another session or kind than its key")
            return
        self.counts.messages += 1
        watched = self._watched.get(message.session) or self._watch(message.session)
        watched.heard_s = self._now_s()
        watched.view.take(message, watched.heard_s)
        if watched.past.is_done() and watched.view.chronicle.episodes.missing() is not None:
            self._ask(message.session, watched)

    def _key_of(self, message: Decision | Step | Episode | Crowd) -> str:
        match message:
            case Decision():
                return self._keys.decision(message.session)
            case Crowd():
                return self._keys.crowd(message.session, message.aggregator)
            case _:
                return self._keys.measures(message.session)

    def _take_page(self, told: Told) -> None:
        watched = self._watched.get(told.session)
        if watched is None or watched.past.is_done():
            return
        try:
            watched.past.take(told.reply)
        except DecodeError as error:
            self._count_malformed(self._keys.learner("rows"), str(error))
        if watched.past.is_done():
            self._ask(told.session, watched)

    def _count_malformed(self, key: str, detail: str) -> None:
        self.counts.malformed += 1
        if self.counts.malformed == 1:
            _LOG.warning(
                "a message on %s cannot be read and is skipped, as all like it: %s", printable(key), detail
            )
        if (watched := self._watched.get(self._session_of(key))) is not None:
            watched.view.chronicle.note(f"a message cannot be read and is skipped: {detail}", level="WARN")

    def _take_list(self, listed: Listed) -> None:
        try:
            sessions = union(reply.payload for reply in listed.replies if reply.ok).sessions
        except DecodeError as error:
            self._count_malformed(self._keys.learner("list"), str(error))
            return
        for summary in _worth_watching(sessions)[-self._config.sessions_max :]:
            if summary.session not in self._watched and self._has_room():
                self._watch(summary.session)

    def _take_report(self, shown: Shown) -> None:
        watched = self._watched.get(shown.session)
        if watched is None:
            return
        watched.asking = False
        episodes = watched.view.chronicle.episodes
        full_page = False
        if shown.reply is not None and shown.reply.ok:
            try:
                report = decode(shown.reply.payload, SessionReport)
            except DecodeError as error:
                self._count_malformed(self._keys.decision(shown.session), str(error))
            else:
                before = episodes.expected()
                watched.view.take_report(report)
                full_page = len(report.episodes) >= REPORT_EPISODES_MAX and episodes.expected() > before
        if full_page:
            self._ask(shown.session, watched)
        elif watched.past.is_done() and episodes.missing() is not None:
            watched.view.chronicle.give_up_missing()

    def _ask(self, session: str, watched: _Watched) -> None:
        if watched.asking:
            return
        watched.asking = True
        query = SessionQuery(session=session, first_episode=watched.view.chronicle.episodes.expected())
        self._bus.ask(
            self._keys.learner("show"),
            encode(query),
            lambda reply: self.inbox.put_reply(Shown(session, reply)),
            ASK_TIMEOUT_MS,
        )

    def _session_of(self, key: str) -> str:
        return key.removeprefix(f"{self._keys.root}/session/").split("/")[0]

    def _has_room(self) -> bool:
        """Tell whether one more session can be shown, if need be in the place of one that is quiet."""
        if len(self._watched) < self._config.sessions_max:
            return True
        quietest_s = min(watched.heard_s for watched in self._watched.values())
        return self._now_s() - quietest_s >= self._config.gives_way_s

    def _leave_out(self, session: str) -> None:
        if not self._unshown:
            text = "more sessions go on than the %d that are shown: `sfid monitor --session NAME` shows one"
            _LOG.warning(text, self._config.sessions_max)
        self._unshown[session] = self._now_s()

    def _watch(self, session: str) -> _Watched:
        """Begin to show a session, in the place of the quietest when there are too many."""
        if len(self._watched) >= self._config.sessions_max:
            self._unwatch(min(self._watched, key=lambda name: self._watched[name].heard_s))
        self._unshown.pop(session, None)
        now_s = self._now_s()
        recording_id = f"{self._config.deployment}-{session}"
        view = SessionView(now_s, past=True, teach=self._config.teach)
        past = Past(session, view, lambda query: self._ask_rows(session, query))
        watched = _Watched(view, past, self._recording(session, recording_id), recording_id, now_s)
        self._watched[session] = watched
        past.begin()
        return watched

    def _recording(self, session: str, recording_id: str) -> Recording | None:
        folder = self._config.recording_dir
        if folder is None:
            return None
        try:
            return Recording(new_file(folder, session), session, recording_id)
        except MonitorError as error:
            _LOG.error("session %s is watched without a recording: %s", session, error)
            return None

    def _ask_rows(self, session: str, query: bytes) -> None:
        self._bus.ask(
            self._keys.learner("rows"),
            query,
            lambda reply: self.inbox.put_reply(Told(session, reply)),
            ASK_TIMEOUT_MS,
        )

    def _unwatch(self, session: str) -> None:
        watched = self._watched.pop(session)
        try:
            self._show(watched, watched.view.flush(self._now_s()))
        finally:
            self.counts.unreadable_views += watched.view.unreadable_views
            if watched.recording is not None:
                watched.recording.close()
            if self._live is not None:
                self._live.forget(watched.recording_id)

    def _show(self, watched: _Watched, due: Due) -> None:
        self.counts.pictures += len(due.kept.scene)
        if watched.recording is not None:
            watched.recording.write(due.kept)
        if self._live is not None:
            self._show_live(self._live, watched, due.live)

    def _show_live(self, live: Live, watched: _Watched, rows: Rows) -> None:
        """Show rows to viewers, and hold those of a session that waits back while another is shown.

        A viewer that comes opens the session that was shown last; it is to find one where something happens.
        """
        if watched.held is not None:
            others = any(each.held is None and not each.view.is_finished for each in self._watched.values())
            if others and not watched.view.has_begun:
                if rows.scene or rows.curves:  # most rounds bring nothing, and would push out what did
                    watched.held.append(rows)
                return
            for earlier in watched.held:
                live.show(watched.recording_id, earlier)
            watched.held = None
        live.show(watched.recording_id, rows)

    def _now_s(self) -> float:
        return self._clock.now_ns() / 1e9


def _decoded(received: Received) -> Decision | Step | Episode | Crowd:
    # `decode` takes a union as well as a class, but a union has no type that says so.
    return decode(received.payload, cast("type[Decision]", Decision | Step | Episode | Crowd))


def _worth_watching(sessions: tuple[SessionSummary, ...]) -> list[SessionSummary]:
    """The sessions that go on; where none does, the last one."""
    return [summary for summary in sessions if summary.phase != "finished"] or list(sessions[-1:])
