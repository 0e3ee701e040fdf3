"""What is kept of one session: rows as a pure fold of its messages, told live or from the journal.

No clock is read and no batch is counted: the same messages give the same rows, whoever tells them and when.
A decision carries no time of its own and stands at that of the last step before it.
"""

from collections import deque
from collections.abc import Callable

from protocol.crowd_message import Crowd
from protocol.messages import Decision, Episode, Step
from services.gym.rendering import is_board
from services.monitor import sampling
from services.monitor.curves import Agreement, EpisodeCurves, EpisodeSequence, EventLog, Lanes
from services.monitor.doubt_pictures import DoubtRows
from services.monitor.doubts import Doubts
from services.monitor.policy import ValueMirror, draw_policy
from services.monitor.reliability import Reliability
from services.monitor.rows import Document, Moment, Picture, Rows
from services.monitor.sampling import Pace
from services.monitor.scene import (
    TeacherColours,
    ViewError,
    draw_world,
    frame_of_decision,
    frames_of_step,
    read_view,
)
from services.monitor.status import (
    EPISODES,
    EPISODES_SHOWN,
    NOW,
    episodes_markdown,
    event_of_episode,
    events_between,
    heading_of,
    step_markdown,
)

EPISODE_NUMBER_MAX = 1_000_000
"""The largest session there can be (CreateSession.episodes)."""
PLAUSIBLE_WALL_NS = 10**18
"""2001-09-09: a sender's time before that is no wall clock, and the row has none."""


class Chronicle:
    """One session's rows, in order; `take` hands out those since the last call."""

    def __init__(self) -> None:
        self.episodes = EpisodeSequence()
        self.colours = TeacherColours()
        self.mirror = ValueMirror()
        self.agreement = Agreement()
        self.decision: Decision | None = None
        self.unreadable_views = 0
        self.moment = Moment(0)
        self._step_due = 0
        self._epoch = 0
        self._crowds: dict[str, tuple[int, int]] = {}
        self._rows = Rows()
        self._curves = EpisodeCurves()
        self._lanes = Lanes()
        self._reliability = Reliability(self.colours)
        self._doubts = Doubts()
        self._doubt_rows = DoubtRows()
        self._events = EventLog()
        self._picture, self._spoken = Pace(sampling.PICTURE_MS), Pace(sampling.SPOKEN_PICTURE_MS)
        self._policy, self._doubt = Pace(sampling.POLICY_MS), Pace(sampling.DOUBTS_MS)
        self._line, self._table = Pace(sampling.EPISODE_LINE_MS), Pace(sampling.TABLE_MS)
        self._latest: deque[Episode] = deque(maxlen=EPISODES_SHOWN)
        self._doubts_changed = False

    def tell(self, message: Decision | Step | Episode | Crowd) -> None:
        """Take the next message; one that was taken before changes nothing."""
        match message:
            case Decision():
                self._tell_decision(message)
            case Step():
                # A killed learner takes up again before what it had not committed: that happens anew.
                if message.decision >= self._step_due or message.epoch > self._epoch:
                    self._step_due, self._epoch = message.decision + 1, message.epoch
                    self._tell_step(message)
            case Episode():
                self.offer_episodes((message,))
            case Crowd():
                self._tell_crowd(message)

    def offer_episodes(self, episodes: tuple[Episode, ...]) -> None:
        """Take finished episodes, also ones taken before; they are shown in order, each once."""
        for episode in episodes:
            if episode.episode < EPISODE_NUMBER_MAX:
                self.episodes.offer(episode)
        self.show_episodes()

    def show_episodes(self) -> None:
        """Move the episodes whose turn it is to the curves."""
        for episode in self.episodes.take():
            wall_ns = wall(episode.at_ns)
            self._curves.add(episode, wall_ns)
            moment = Moment(episode.decision, wall_ns, episode.episode)
            if self._line.due(episode.at_ns):
                self.note(event_of_episode(episode), moment)
            self._latest.append(episode)
            if self._table.due(episode.at_ns) or self._is_last(episode.episode):
                heading = None if self.decision is None else heading_of(self.decision)
                self._rows.curves.append(Document(EPISODES, moment, episodes_markdown(self._latest, heading)))

    def give_up_missing(self) -> None:
        """Show the episodes that wait for others, without those."""
        while self.episodes.missing() is not None:
            self.episodes.skip()
            self.show_episodes()

    def note(self, text: str, moment: Moment | None = None, level: str = "INFO") -> None:
        """Add a line to the event log."""
        self._events.add(moment or self.moment, text, level)

    def has_lane(self, teacher: str) -> bool:
        """Tell whether what this teacher says is shown as a lane."""
        return self._lanes.has(teacher)

    def of_two(self) -> bool:
        """Tell whether two teachers alone labelled the steps so far.

        What an aggregator reports has no part in it: the journal does not tell it, and what is told of a step
        is the same again from there.
        """
        return self._reliability.of_two()

    def take(self) -> Rows:
        """Return the rows since the last call."""
        rows, self._rows = self._rows, Rows()
        for kept in (self._curves, self.agreement, self._reliability, self._lanes, self._events):
            rows.curves.extend(kept.take())
        return rows

    def _tell_decision(self, decision: Decision) -> None:
        before = self.decision
        if before is not None and (decision.epoch, decision.sequence) <= (before.epoch, before.sequence):
            return
        self.decision = decision
        self.moment = Moment(decision.decision, self.moment.wall_ns, decision.episode)
        for text in events_between(before, decision):
            self.note(text)
        if before is None and decision.view:
            self._try(
                lambda: self._rows.scene.append(draw_world(frame_of_decision(decision, None), self.colours))
            )

    def _tell_step(self, step: Step) -> None:
        moment = self.moment = Moment(step.decision, wall(step.at_ns), step.episode)
        self.mirror.learn(step.state, step.values)
        for said in step.said:
            self.colours.of(said.teacher)
        self.agreement.add(step, moment)
        self._reliability.add(step, moment)
        self._lanes.add(step, moment)
        self._try(lambda: self._draw(step, moment))

    def _try(self, draw: Callable[[], None]) -> None:
        try:
            draw()
        except ViewError as error:
            self.count_unreadable(error)

    def count_unreadable(self, error: ViewError) -> None:
        """Count a view that cannot be drawn; the first is told."""
        self.unreadable_views += 1
        if self.unreadable_views == 1:
            self.note(f"a view cannot be drawn: {error}", level="WARN")

    def _draw(self, step: Step, moment: Moment) -> None:
        ended = step.outcome != "running"
        spoken = bool(step.said)
        board = is_board(step.view)
        if spoken and board:
            self._doubts_changed |= self._doubts.add(step, read_view(step.view).player)
        if (self._spoken if spoken else self._picture).due(step.at_ns):
            for frame in frames_of_step(step, moment.wall_ns):
                self._rows.scene.append(draw_world(frame, self.colours))
            self._rows.curves.append(
                Document(NOW, moment, step_markdown(step, self.decision, of_two=self.of_two()))
            )
        if board and self._policy.due(step.at_ns):
            self._rows.scene.append(draw_policy(read_view(step.view), self.mirror, moment))
        if self._doubts_changed and (self._doubt.due(step.at_ns) or (ended and self._is_last(step.episode))):
            self._doubts_changed = False
            for row in self._doubt_rows.changed(self._doubts, step.view, moment, step.at_ns):
                if isinstance(row, Picture):
                    self._rows.scene.append(row)
                else:
                    self._rows.curves.append(row)

    def _is_last(self, episode: int) -> bool:
        return self.decision is not None and episode + 1 >= self.decision.episodes

    def _tell_crowd(self, crowd: Crowd) -> None:
        if (crowd.epoch, crowd.decision) <= self._crowds.get(crowd.aggregator, (-1, -1)):
            return
        self._crowds[crowd.aggregator] = crowd.epoch, crowd.decision
        self._reliability.add_crowd(crowd, Moment(crowd.decision, wall(crowd.at_ns)))


def wall(at_ns: int) -> int | None:
    """Return a message's time if it can be a wall clock's."""
    return at_ns if PLAUSIBLE_WALL_NS <= at_ns < 2**63 else None
