"""Episode curves, label agreement, lanes and events: collected row by row, handed out in batches."""

from collections import deque
from typing import TypeVar

import numpy as np

from protocol.messages import Episode, Step
from services.monitor.rows import Curves, Events, Lane, Moment

T = TypeVar("T")

AGREEMENT_LABELS = 50
"""Labels that the rolling agreement looks back on."""
AGREEMENT_POINTS_MAX = 20
"""Points of the rolling agreement in one batch: the last of each of 20 equal stretches."""
STEPS_AVERAGED = 10
"""Episodes that the smooth line of steps is the mean of."""
LANES_MAX = 8
"""Teachers with a lane of their own: each lane is a message a batch, and a screen shows no more."""
LANE_LABELS_MAX = 40
"""Labels of a lane in one batch, the newest; people give fewer, scripts give thousands."""
EVENTS_MAX = 12
"""Lines of the event log in one batch; the rest is told as a number."""
WAITING_MAX = 2_000
"""Episodes held back while earlier ones are being asked for."""

STEPS, TD_ERROR, RETURN, INPUTS, AGREEMENT = (
    f"curves/{name}" for name in ("steps", "td_error", "return", "inputs", "agreement")
)
SERIES: dict[str, tuple[str, ...]] = {
    STEPS: ("steps", f"mean of the last {STEPS_AVERAGED}", "fewest possible"),
    TD_ERROR: ("environment alone (Eq. 2)", "with the teachers' part (Eq. 4)"),
    RETURN: ("environment and teachers", "environment alone"),
    INPUTS: ("teacher inputs",),
    AGREEMENT: (f"of the last {AGREEMENT_LABELS} labels",),
}
"""Every curve, by entity, in the order of its values."""


def decimate(rows: list[T], rows_max: int) -> list[T]:
    """Return at most `rows_max` rows: the last of each of as many equal stretches."""
    if len(rows) <= rows_max:
        return rows
    ends = [len(rows) * (number + 1) // rows_max - 1 for number in range(rows_max)]
    return [rows[end] for end in ends]


class EpisodeSequence:
    """Episodes in order and each once, whatever order and how often they arrive.

    `missing` tells what to ask the learner for; `skip` goes on without it.
    """

    __slots__ = ("_next", "_waiting")

    def __init__(self) -> None:
        self._next = 0
        self._waiting: dict[int, Episode] = {}

    def offer(self, episode: Episode) -> None:
        """Take one; an episode handed out before, or one too many, is not taken."""
        if episode.episode >= self._next and len(self._waiting) < WAITING_MAX:
            self._waiting[episode.episode] = episode

    def missing(self) -> int | None:
        """Return the first episode that later ones are waiting for, or None."""
        return self._next if self._waiting and self._next not in self._waiting else None

    def expected(self) -> int:
        """Return the number of the episode that comes next."""
        return self._next

    def skip(self) -> None:
        """Give up what is missing before the first one waiting."""
        if self._waiting:
            self._next = min(self._waiting)

    def take(self) -> list[Episode]:
        """Return what can be handed out now, in order."""
        taken = []
        while (episode := self._waiting.pop(self._next, None)) is not None:
            taken.append(episode)
            self._next += 1
        return taken


class EpisodeCurves:
    """The curves with one row an episode: every row is kept, none is thinned out."""

    __slots__ = ("_moments", "_recent", "_values")

    def __init__(self) -> None:
        self._recent: deque[int] = deque(maxlen=STEPS_AVERAGED)
        self._moments: list[Moment] = []
        self._values: dict[str, list[tuple[float, ...]]] = {STEPS: [], TD_ERROR: [], RETURN: [], INPUTS: []}

    def add(self, episode: Episode, wall_ns: int) -> None:
        """Add a row; episodes come in order."""
        self._recent.append(episode.steps)
        self._moments.append(Moment(episode.decision, wall_ns, episode.episode))
        fewest = float("nan") if episode.optimal_steps is None else float(episode.optimal_steps)
        mean = sum(self._recent) / len(self._recent)
        self._values[STEPS].append((float(episode.steps), mean, fewest))
        self._values[TD_ERROR].append((episode.abs_td_error, episode.abs_td_error_shaped))
        self._values[RETURN].append((episode.discounted_return, episode.discounted_env_return))
        self._values[INPUTS].append((float(episode.inputs),))

    def take(self) -> list[Curves]:
        """Return the rows since the last call, a batch for each entity."""
        if not self._moments:
            return []
        moments, self._moments = tuple(self._moments), []
        batches = [Curves(entity, moments, np.array(rows)) for entity, rows in self._values.items()]
        for rows in self._values.values():
            rows.clear()
        return batches


class Agreement:
    """How often the agent's action was the one a teacher named, over the last labels of single teachers."""

    __slots__ = ("_agreed", "_rows")

    def __init__(self) -> None:
        self._agreed: deque[bool] = deque(maxlen=AGREEMENT_LABELS)
        self._rows: list[tuple[Moment, float]] = []

    def add(self, step: Step, moment: Moment) -> None:
        """Count the labels of a step; a step without labels adds no point."""
        agreed = [said.action == step.action for said in step.said if said.kind == "label"]
        if agreed:
            self._agreed.extend(agreed)
            self._rows.append((moment, sum(self._agreed) / len(self._agreed)))
            if len(self._rows) > AGREEMENT_POINTS_MAX * 64:
                self._rows = decimate(self._rows, AGREEMENT_POINTS_MAX)

    def take(self) -> list[Curves]:
        """Return the points since the last call, thinned out."""
        rows, self._rows = decimate(self._rows, AGREEMENT_POINTS_MAX), []
        if not rows:
            return []
        return [
            Curves(AGREEMENT, tuple(moment for moment, _ in rows), np.array([[value] for _, value in rows]))
        ]


class Lanes:
    """What each teacher said, decision by decision."""

    __slots__ = ("_lanes",)

    def __init__(self) -> None:
        self._lanes: dict[str, deque[tuple[Moment, str]]] = {}

    def add(self, step: Step, moment: Moment) -> None:
        """Add the labels of a step; teachers beyond the number of lanes are left out."""
        for said in step.said:
            if said.action is None or (said.teacher not in self._lanes and len(self._lanes) >= LANES_MAX):
                continue
            lane = self._lanes.setdefault(said.teacher, deque(maxlen=LANE_LABELS_MAX))
            lane.append((moment, said.action))

    def take(self) -> list[Lane]:
        """Return the lanes with anything new; a label lasts one decision."""
        return [self._lane(teacher, lane) for teacher, lane in self._lanes.items() if lane]

    def _lane(self, teacher: str, lane: deque[tuple[Moment, str]]) -> Lane:
        said = {moment.decision: (moment, state) for moment, state in lane}
        lane.clear()
        ends = {
            decision + 1: (Moment(decision + 1, moment.wall_ns), "") for decision, (moment, _) in said.items()
        }
        rows = [row for _, row in sorted({**ends, **said}.items())]
        return Lane(teacher, tuple(moment for moment, _ in rows), tuple(state for _, state in rows))


class EventLog:
    """Lines for the event log; a flood is cut and counted."""

    __slots__ = ("_cut", "_rows")

    def __init__(self) -> None:
        self._rows: list[tuple[Moment, str, str]] = []
        self._cut = 0

    def add(self, moment: Moment, text: str, level: str = "INFO") -> None:
        """Add a line; level is INFO or WARN."""
        if len(self._rows) < EVENTS_MAX:
            self._rows.append((moment, text, level))
        else:
            self._cut += 1
            self._rows[-1] = (moment, f"… and {self._cut + 1} more events", "INFO")

    def take(self) -> list[Events]:
        """Return the lines since the last call."""
        rows, self._rows, self._cut = self._rows, [], 0
        if not rows:
            return []
        moments, texts, levels = zip(*rows, strict=True)
        return [Events(moments, texts, levels)]
