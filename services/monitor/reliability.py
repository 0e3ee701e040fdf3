"""How reliable each teacher is, with the error of the estimate: told by an aggregator, or found from labels.

Without an aggregator the labels of teachers who answer side by side are weighed as a crowd's would be (one
accuracy a teacher, `sfid_core.crowd`); one teacher alone has nobody to be compared with.
"""

from protocol.crowd_message import Crowd
from protocol.messages import Step
from services.monitor.rows import Moment, Reliabilities
from services.monitor.sampling import RELIABILITY_MS, Pace
from services.monitor.scene import TeacherColours
from sfid_core.crowd.online import CrowdMethod, CrowdSettings, OnlineAggregate
from sfid_core.sokoban.actions import ACTIONS

TEACHERS_MAX = 8
"""Teachers with a curve: a screen tells no more colours apart."""
LEGEND_OF_TWO = " (of two: which one errs is unknown)"
"""Where two differ nothing tells which of them errs: their curves are one."""
_NUMBERS = {action.name: index for index, action in enumerate(ACTIONS)}
_Point = tuple[Moment, float, float]
_Curve = tuple[str, str]
"""A teacher, and how the legend calls them."""


class Reliability:
    """Curves of reliability, a point a second of the session's time at most."""

    __slots__ = ("_aggregate", "_colours", "_names", "_pace", "_rows")

    def __init__(self, colours: TeacherColours) -> None:
        self._aggregate = OnlineAggregate(len(ACTIONS), CrowdSettings(method=CrowdMethod.ONE_COIN))
        self._colours = colours
        self._names: dict[str, None] = {}
        self._pace = Pace(RELIABILITY_MS)
        self._rows: dict[_Curve, list[_Point]] = {}

    def add(self, step: Step, moment: Moment) -> None:
        """Learn from a step that two teachers or more labelled."""
        labels: dict[str, int | None] = {
            said.teacher: _NUMBERS[said.action] for said in step.said if said.action in _NUMBERS
        }
        if len(labels) < 2:
            return
        self._aggregate.learn(labels)
        if self._pace.due(step.at_ns):
            end = LEGEND_OF_TWO if self.of_two() else ""
            for teacher in self._aggregate.workers():
                known = self._aggregate.reliability(teacher)
                self._note(teacher, teacher + end, (moment, known.mean, known.standard_error))

    def of_two(self) -> bool:
        """Tell whether two were compared with each other, and with nobody else."""
        return len(self._aggregate.workers()) == 2

    def add_crowd(self, crowd: Crowd, moment: Moment) -> None:
        """Take over what an aggregator has found out about its workers."""
        if self._pace.due(crowd.at_ns):
            for worker in crowd.workers:
                self._note(worker.worker, worker.worker, (moment, worker.mean, worker.standard_error))

    def _note(self, teacher: str, label: str, point: _Point) -> None:
        if teacher in self._names or len(self._names) < TEACHERS_MAX:
            self._names[teacher] = None
            self._rows.setdefault((teacher, label), []).append(point)

    def take(self) -> list[Reliabilities]:
        """Return the points since the last call, a batch for each teacher."""
        rows, self._rows = self._rows, {}
        return [
            Reliabilities(teacher, label, self._colours.of(teacher), *zip(*points, strict=True))
            for (teacher, label), points in rows.items()
        ]
