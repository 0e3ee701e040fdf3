"""Episode curves, label agreement, lanes and events: collected row by row, handed out in batches."""

from collections import deque
from collections.abc import Iterable

import numpy as np

from protocol.messages import Episode, SaidBy, Step
from services.monitor.rows import Curves, Events, Lane, Moment
from services.monitor.sampling import AGREEMENT_MS, LABELS_MS, Pace

AGREEMENT_LABELS = 50
"""Labels that the rolling agreement looks back on."""
STEPS_AVERAGED = 10
"""Episodes that the smooth line of steps is the mean of."""
DIFFERED = "≠"
"""Ends the state of a lane where the agent did something else than was said."""
LANES_MAX = 8
"""Teachers with a lane of their own: each lane is a message a batch, and a screen shows no more."""
EVENTS_MAX = 1_000
"""Lines of the event log in one batch; more than that is told as a number."""
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

    def add(self, episode: Episode, wall_ns: int | None) -> None:
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

    __slots__ = ("_agreed", "_pace", "_rows")

    def __init__(self) -> None:
        self._agreed: deque[bool] = deque(maxlen=AGREEMENT_LABELS)
        self._pace = Pace(AGREEMENT_MS)
        self._rows: list[tuple[Moment, float]] = []

    def add(self, step: Step, moment: Moment) -> None:
        """Count the labels of a step; a step without labels adds no point."""
        agreed = [said.action == step.action for said in step.said if said.kind == "label"]
        if not agreed:
            return
        self._agreed.extend(agreed)
        if self._pace.due(step.at_ns):
            self._rows.append((moment, self.share()))

    def share(self) -> float:
        """Return the rolling share; NaN before the first label."""
        return sum(self._agreed) / len(self._agreed) if self._agreed else float("nan")

    def take(self) -> list[Curves]:
        """Return the points since the last call."""
        rows, self._rows = self._rows, []
        if not rows:
            return []
        values = np.array([[value] for _, value in rows])
        return [Curves(AGREEMENT, tuple(moment for moment, _ in rows), values)]


class Lanes:
    """What each teacher said, step by step; a label lasts until the step after it."""

    __slots__ = ("_open", "_paces", "_rows")

    def __init__(self) -> None:
        self._paces: dict[str, Pace] = {}
        self._open: set[str] = set()
        self._rows: dict[str, list[tuple[Moment, str]]] = {}

    def add(self, step: Step, moment: Moment) -> None:
        """Add the labels of a step; teachers beyond the number of lanes are left out."""
        if not step.said and not self._open:
            return
        said = states_said(step.said, step.action)
        for teacher in (*said, *(teacher for teacher in sorted(self._open) if teacher not in said)):
            if teacher not in self._paces:
                if len(self._paces) >= LANES_MAX:
                    continue
                self._paces[teacher] = Pace(LABELS_MS)
            self._add(teacher, said.get(teacher), step.at_ns, moment)

    def _add(self, teacher: str, state: str | None, at_ns: int, moment: Moment) -> None:
        if state is not None and self._paces[teacher].due(at_ns):
            self._open.add(teacher)
        elif teacher in self._open:
            self._open.discard(teacher)
            state = None
        else:
            return
        self._rows.setdefault(teacher, []).append((moment, state or ""))

    def has(self, teacher: str) -> bool:
        """Tell whether this teacher has a lane."""
        return teacher in self._paces

    def take(self) -> list[Lane]:
        """Return what is new in each lane."""
        rows, self._rows = self._rows, {}
        return [
            Lane(teacher, tuple(at for at, _ in lane), tuple(state for _, state in lane))
            for teacher, lane in rows.items()
        ]


def states_said(said: Iterable[SaidBy], went: str | None) -> dict[str, str]:
    """Return the state of each teacher's lane who labelled a step on which the agent went one way."""
    return {
        each.teacher: each.action if each.action == went else each.action + DIFFERED
        for each in said
        if each.action is not None and each.kind == "label"
    }


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
