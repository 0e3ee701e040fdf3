"""One session as it is watched: the chronicle's rows for keeping, and what moves between them for viewers.

Time is an argument; no thread, no wire, no viewer.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from protocol.crowd_message import Crowd
from protocol.messages import Decision, Episode, SessionReport, Step, World
from services.gym.rendering import is_board
from services.monitor.chronicle import Chronicle, wall
from services.monitor.config import TEACH
from services.monitor.curves import states_said
from services.monitor.policy import draw_policy
from services.monitor.rows import Curves, Document, Lane, Moment, Picture, Row, Rows, merged
from services.monitor.sampling import LIVE_POINT_MS, Pace
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
from services.monitor.status import NOW, open_markdown

SCENE_PERIOD_S = 0.1
COUNT_DOWN_PERIOD_S = 0.2
POLICY_PERIOD_S = 0.5
STATUS_PERIOD_S = 0.5
FILE_PERIOD_S = 30.0
"""A killed monitor loses so much of its file; `sfid export` makes it anew from the journal. Rows that were
written as they come would fill the memory within hours: see `rows.merged`."""
CURVES_PERIOD_S = 2.0
CURVES_PERIOD_LATER_S = 5.0
"""After an hour: a late joiner replays the whole history, and few messages keep that short."""
LATER_S = 3600.0
EARLIER_MAX = 8192
"""Messages held back while the past is being told."""
PAST_PICTURES_MAX = 600
"""Pictures of the past that viewers get when a monitor starts late; the recording has all."""
RECENT_EPISODES = 80

Message = Decision | Step | Episode | Crowd


@dataclass(slots=True)
class Due:
    """What is to be written now: to the file, and to viewers."""

    kept: Rows = field(default_factory=Rows)
    live: Rows = field(default_factory=Rows)


class SessionView:
    """Everything the monitor keeps about one session, bounded.

    Args: past: what happened before is told first; teach: how the session is taught (`MonitorConfig.teach`).
    """

    def __init__(self, opened_s: float, *, past: bool = False, teach: str = TEACH) -> None:
        self._teach = teach
        self.chronicle = Chronicle()
        self.recent: deque[Episode] = deque(maxlen=RECENT_EPISODES)
        """The latest episodes, for the overview."""
        self.report: SessionReport | None = None
        self.decision: Decision | None = None
        self.view = ""
        self.decided_s = opened_s
        """When the learner last said anything."""
        self._earlier: deque[Message] | None = deque(maxlen=EARLIER_MAX) if past else None
        self._opened_s = opened_s
        self._due_s = dict.fromkeys(
            ("file", "taken", "scene", "count-down", "policy", "status", "curves"), opened_s
        )
        self._stage = Stage()
        self._shown: Frame | None = None
        self._spoke: set[str] = set()
        """Who said something on the frame that is shown."""
        self._policy_stale = False
        self._told = ""
        self._unwritten = Rows()
        self._waiting: list[Row] = []
        self._past: deque[Picture] = deque(maxlen=PAST_PICTURES_MAX)
        self._points: dict[str, Pace] = {}

    @property
    def unreadable_views(self) -> int:
        """Views that could not be drawn."""
        return self.chronicle.unreadable_views

    @property
    def has_begun(self) -> bool:
        """Whether anything has happened in the session yet: until then it waits for its teachers."""
        if self.decision is not None and (self.decision.phase != "gathering" or self.decision.decision > 0):
            return True
        # Its report says so too: a journal whose rows cannot be read tells no step and no episode.
        reported = self.report is not None and (
            self.report.summary.decision > 0 or bool(self.report.episodes)
        )
        return reported or bool(self.recent) or len(self.chronicle.mirror) > 0

    @property
    def is_finished(self) -> bool:
        """Whether the session is known to have ended."""
        if self.decision is not None:
            return self.decision.phase == "finished"
        return self.report is not None and self.report.summary.phase == "finished"

    def take(self, message: Message, now_s: float) -> None:
        """Take a message as it comes: it is watched at once, and kept after what came before it."""
        self.decided_s = now_s
        match message:
            case Decision():
                self._watch_decision(message)
            case Step():
                self._policy_stale = True
                self.view = message.next_view
                self._stage.offer(frames_of_step(message, wall(message.at_ns)))
            case Episode():
                self.recent.append(message)
        if self._earlier is None:
            self.chronicle.tell(message)
        else:
            self._earlier.append(message)

    def retell(self, message: Message) -> None:
        """Take a message of the past, in its order."""
        if isinstance(message, Episode):
            self.recent.append(message)
        self.chronicle.tell(message)

    def past_is_told(self) -> None:
        """Go on with what came in the meantime."""
        earlier, self._earlier = self._earlier or (), None
        for message in earlier:
            self.chronicle.tell(message)

    def take_report(self, report: SessionReport) -> None:
        """Take what the learner tells about the session."""
        self.chronicle.offer_episodes(report.episodes)
        self.report = report
        if not self.view and self._shown is None:
            world = report.config.world
            self.view = world.level if isinstance(world, World) else ""
            self._stage.offer((Frame(Moment(report.summary.decision), self.view),))

    def left_s(self, now_s: float) -> float | None:
        """Return the seconds until the open window closes; None without a deadline."""
        if self.decision is None or self.decision.remaining_ms is None:
            return None
        return max(0.0, self.decision.remaining_ms / 1000 - (now_s - self.decided_s))

    def tick(self, now_s: float, pace: int = 1) -> Due:
        """Return what is due; viewers wait `pace` times as long: sessions and viewers share one rate."""
        due = Due()
        if self._is_due("taken", now_s, CURVES_PERIOD_S):
            self._take_kept()
        if self._is_due("file", now_s, FILE_PERIOD_S):
            due.kept = self._to_be_written()
        if self._is_due("scene", now_s, SCENE_PERIOD_S * pace):
            self._draw_scene(due.live, now_s, pace)
        if self._policy_stale and self._is_due("policy", now_s, POLICY_PERIOD_S * pace):
            self._draw_policy(due.live)
        if self._is_due("status", now_s, STATUS_PERIOD_S * pace):
            self._tell_status(due.live, now_s)
        later = now_s - self._opened_s > LATER_S
        if self._is_due("curves", now_s, (CURVES_PERIOD_LATER_S if later else CURVES_PERIOD_S) * pace):
            self._send_waiting(due.live)
        return due

    def flush(self, now_s: float) -> Due:
        """Return everything that has not been returned yet."""
        self.past_is_told()
        self.chronicle.give_up_missing()
        self._take_kept()
        due = Due(kept=self._to_be_written())
        # A held frame and one after it at most: what was on stage when the session's view ends.
        for number in range(3):
            self._draw_scene(due.live, now_s + 60.0 * (number + 1), 1)
        self._draw_policy(due.live)
        self._tell_status(due.live, now_s)
        self._send_waiting(due.live)
        return due

    def _watch_decision(self, decision: Decision) -> None:
        before = self.decision
        if before is not None and (decision.epoch, decision.sequence) <= (before.epoch, before.sequence):
            return
        self.decision = decision
        if decision.view:
            self.view = decision.view
            self._stage.offer((frame_of_decision(decision, None),))

    def _take_kept(self) -> None:
        """Take the chronicle's rows: all for the file; for viewers the curves, thinned, and past pictures."""
        rows = self.chronicle.take()
        self._unwritten.scene += rows.scene
        self._unwritten.curves += rows.curves
        for row in rows.curves:
            if not isinstance(row, Document) or row.entity != NOW:
                self._waiting.append(self._thinned(row) if isinstance(row, Curves) else row)
        # The world and the policy are drawn for viewers as they are; what the chronicle draws beside them
        # is for both, and so is the past.
        self._waiting.extend(row for row in rows.scene if row.entity not in {"world", "policy"})
        if self._earlier is not None:
            self._past.extend(row for row in rows.scene if row.entity == "world")

    def _to_be_written(self) -> Rows:
        rows, self._unwritten = self._unwritten, Rows()
        return Rows(rows.scene, merged(rows.curves))

    def _thinned(self, row: Curves) -> Curves:
        pace = self._points.setdefault(row.entity, Pace(LIVE_POINT_MS))
        kept = [number for number, at in enumerate(row.moments) if at.wall_ns is None or pace.due(at.wall_ns)]
        return Curves(row.entity, tuple(row.moments[number] for number in kept), row.values[kept])

    def _send_waiting(self, rows: Rows) -> None:
        waiting, self._waiting = _newest_texts(self._waiting), []
        rows.curves.extend(merged(row for row in waiting if not isinstance(row, Curves) or row.moments))
        if self._earlier is None and self._past:
            rows.scene[:0] = self._past
            self._past.clear()

    def _is_due(self, what: str, now_s: float, period_s: float) -> bool:
        if now_s < self._due_s[what]:
            return False
        self._due_s[what] = now_s + period_s
        return True

    def _draw_scene(self, rows: Rows, now_s: float, pace: int) -> None:
        frame = self._stage.due(now_s)
        if frame is None:
            self._draw_count_down(rows, now_s, pace)
            return
        try:
            picture = draw_world(frame, self._colours(), self._share_left(frame, now_s))
        except ViewError:  # the chronicle counts it, and tells the first
            return
        rows.scene.append(replace(picture, lanes=self._lanes_of(frame)))
        self._policy_stale |= self._shown is None or self._shown.view != frame.view
        self._shown = frame

    def _lanes_of(self, frame: Frame) -> tuple[Lane, ...]:
        """What was said on a frame, which ends what was said on the one before it."""
        said = states_said(frame.said, frame.action)
        states = dict.fromkeys(sorted(self._spoke - said.keys()), "") | said
        self._spoke = set(said)
        return tuple(
            Lane(teacher, (frame.moment,), (state,))
            for teacher, state in states.items()
            if self.chronicle.has_lane(teacher)
        )

    def _draw_count_down(self, rows: Rows, now_s: float, pace: int) -> None:
        """Draw the open decision again with less time left."""
        shown = self._shown
        if shown is None or self._share_left(shown, now_s) is None:
            return
        if self._stage.is_free(now_s) and self._is_due("count-down", now_s, COUNT_DOWN_PERIOD_S * pace):
            share = self._share_left(shown, now_s)
            rows.scene.append(draw_world(shown, self._colours(), share))

    def _share_left(self, frame: Frame, now_s: float) -> float | None:
        """How much of the window is left, if it is this frame's decision that is open."""
        decision, left_s = self.decision, self.left_s(now_s)
        if decision is None or left_s is None or decision.phase != "asking" or decision.paused:
            return None
        if frame.moment.step != decision.decision or frame.said:
            return None
        return min(1.0, left_s * 1000 / decision.window.span_ms)

    def _colours(self) -> TeacherColours:
        """The chronicle gives colours in the order of the past; what is drawn before that gives none away."""
        return self.chronicle.colours if self._earlier is None else TeacherColours()

    def _draw_policy(self, rows: Rows) -> None:
        if self._shown is None or not self._policy_stale:
            return
        self._policy_stale = False
        if not is_board(self._shown.view):
            return
        board = read_view(self._shown.view)
        rows.scene.append(draw_policy(board, self.chronicle.mirror, self._shown.moment))

    def _tell_status(self, rows: Rows, now_s: float) -> None:
        waited_s = now_s - self.decided_s
        text = open_markdown(
            self.decision,
            self.report,
            self.left_s(now_s),
            waited_s,
            self._teach,
            of_two=self.chronicle.of_two(),
        )
        if text != self._told:
            self._told = text
            rows.curves.append(Document(NOW, self.chronicle.moment, text))


def _newest_texts(rows: Iterable[Row]) -> list[Row]:
    """Leave out each text that a newer one of the batch stands for: nobody would see it, and it is kept."""
    rows = list(rows)
    newest = {row.entity: number for number, row in enumerate(rows) if isinstance(row, Document)}
    return [
        row
        for number, row in enumerate(rows)
        if not isinstance(row, Document) or newest[row.entity] == number
    ]
