"""One session as it is shown: messages in, rows out. Time is an argument; no thread, no wire, no viewer."""

from protocol.messages import Decision, Episode, SessionReport, Step
from services.monitor.curves import Agreement, EpisodeCurves, EpisodeSequence, EventLog, Lanes
from services.monitor.policy import ValueMirror, draw_policy
from services.monitor.rows import Moment, Rows, Status
from services.monitor.scene import (
    Frame,
    Stage,
    TeacherColours,
    ViewError,
    draw_world,
    frame_of_decision,
    frames_of_step,
    read_view,
)
from services.monitor.status import event_of_episode, events_between, status_markdown

SCENE_PERIOD_S = 0.1
POLICY_PERIOD_S = 0.5
STATUS_PERIOD_S = 1.0
LANES_PERIOD_S = 1.0
CURVES_PERIOD_S = 2.0
CURVES_PERIOD_LATER_S = 5.0
"""After an hour: a late joiner replays the whole history, and few messages keep that short."""
LATER_S = 3600.0
EPISODE_NUMBER_MAX = 1_000_000
"""The largest session there can be (CreateSession.episodes)."""
PLAUSIBLE_WALL_NS = 10**18
"""2001-09-09: a sender's time before that is no wall clock, and the monitor's own stands in for it."""


class SessionView:
    """Everything the monitor keeps about one session, bounded."""

    def __init__(self, opened_s: float) -> None:
        self.episodes = EpisodeSequence()
        self.unreadable_views = 0
        self._opened_s = opened_s
        self._due_s = dict.fromkeys(("scene", "policy", "status", "lanes", "curves"), opened_s)
        self._stage = Stage()
        self._colours = TeacherColours()
        self._mirror = ValueMirror()
        self._curves = EpisodeCurves()
        self._agreement = Agreement()
        self._lanes = Lanes()
        self._events = EventLog()
        self._decision: Decision | None = None
        self._report: SessionReport | None = None
        self._moment = Moment(0, 0)
        self._shown: Frame | None = None
        self._policy_stale = False
        self._status_told = ""

    def take(self, message: Decision | Step | Episode, wall_ns: int) -> None:
        """Take a message of this session; `wall_ns` is when it came."""
        match message:
            case Decision():
                self._take_decision(message, wall_ns)
            case Step():
                self._take_step(message, _wall(message.at_ns, wall_ns))
            case Episode():
                self.offer_episodes((message,), wall_ns)

    def offer_episodes(self, episodes: tuple[Episode, ...], wall_ns: int) -> None:
        """Take finished episodes, also ones taken before; they are shown in order, each once."""
        for episode in episodes:
            if episode.episode < EPISODE_NUMBER_MAX:
                self.episodes.offer(episode)
        self.show_episodes(wall_ns)

    def give_up_missing(self, wall_ns: int) -> None:
        """Show the episodes that wait for others, without those."""
        while self.episodes.missing() is not None:
            self.episodes.skip()
            self.show_episodes(wall_ns)

    def show_episodes(self, wall_ns: int) -> None:
        """Move the episodes whose turn it is to the curves."""
        for episode in self.episodes.take():
            at_ns = _wall(episode.at_ns, wall_ns)
            self._curves.add(episode, at_ns)
            self.note(event_of_episode(episode), Moment(episode.decision, at_ns))

    def take_report(self, report: SessionReport, wall_ns: int) -> None:
        """Take what the learner tells about the past."""
        self.offer_episodes(report.episodes, wall_ns)
        self._report = report
        if self._decision is None and self._shown is None:
            self._moment = Moment(report.summary.decision, wall_ns)
            self._stage.offer((Frame(self._moment, report.config.world.level),))

    def note(self, text: str, moment: Moment | None = None, level: str = "INFO") -> None:
        """Add a line to the event log."""
        self._events.add(moment or self._moment, text, level)

    def tick(self, now_s: float, pace: int = 1) -> Rows:
        """Return what is due; `pace` is the number of sessions that share the viewers' message rate."""
        rows = Rows()
        if self._is_due("scene", now_s, SCENE_PERIOD_S * pace):
            self._draw_scene(rows, now_s)
        if self._policy_stale and self._is_due("policy", now_s, POLICY_PERIOD_S * pace):
            self._draw_policy(rows)
        if self._is_due("status", now_s, STATUS_PERIOD_S * pace):
            self._tell_status(rows)
        if self._is_due("lanes", now_s, LANES_PERIOD_S * pace):
            rows.curves.extend(self._lanes.take())
        later = now_s - self._opened_s > LATER_S
        if self._is_due("curves", now_s, (CURVES_PERIOD_LATER_S if later else CURVES_PERIOD_S) * pace):
            self._take_curves(rows)
        return rows

    def flush(self, now_s: float) -> Rows:
        """Return everything that has not been returned yet."""
        rows = Rows()
        # A held frame and one after it at most: what was on stage when the session's view ends.
        for number in range(3):
            self._draw_scene(rows, now_s + 60.0 * (number + 1))
        self._draw_policy(rows)
        self._tell_status(rows)
        rows.curves.extend(self._lanes.take())
        self._take_curves(rows)
        return rows

    def _take_decision(self, decision: Decision, wall_ns: int) -> None:
        before = self._decision
        if before is not None and (decision.epoch, decision.sequence) <= (before.epoch, before.sequence):
            return
        self._decision = decision
        self._moment = Moment(decision.decision, wall_ns)
        for text in events_between(before, decision):
            self.note(text)
        if decision.view:
            self._stage.offer((frame_of_decision(decision, wall_ns),))

    def _take_step(self, step: Step, wall_ns: int) -> None:
        moment = Moment(step.decision, wall_ns)
        self._moment = moment
        self._mirror.learn(step.state, step.values)
        self._policy_stale = True
        self._agreement.add(step, moment)
        self._lanes.add(step, moment)
        self._stage.offer(frames_of_step(step, wall_ns))

    def _is_due(self, what: str, now_s: float, period_s: float) -> bool:
        if now_s < self._due_s[what]:
            return False
        self._due_s[what] = now_s + period_s
        return True

    def _draw_scene(self, rows: Rows, now_s: float) -> None:
        frame = self._stage.due(now_s)
        if frame is None:
            return
        try:
            rows.scene.append(draw_world(frame, self._colours))
        except ViewError as error:
            self.unreadable_views += 1
            if self.unreadable_views == 1:
                self.note(f"a view cannot be drawn: {error}", frame.moment, "WARN")
            return
        self._policy_stale |= self._shown is None or self._shown.view != frame.view
        self._shown = frame

    def _draw_policy(self, rows: Rows) -> None:
        if self._shown is None or not self._policy_stale:
            return
        self._policy_stale = False
        rows.scene.append(draw_policy(read_view(self._shown.view), self._mirror, self._shown.moment))

    def _tell_status(self, rows: Rows) -> None:
        text = status_markdown(self._decision, self._report, self.unreadable_views)
        if text != self._status_told:
            self._status_told = text
            rows.curves.append(Status(self._moment, text))

    def _take_curves(self, rows: Rows) -> None:
        for collected in (self._curves, self._agreement, self._events):
            rows.curves.extend(collected.take())


def _wall(at_ns: int, wall_ns: int) -> int:
    return at_ns if PLAUSIBLE_WALL_NS <= at_ns < 2**63 else wall_ns
