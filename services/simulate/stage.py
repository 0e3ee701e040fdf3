"""One run: all processes of a lesson in one thread, on virtual time, through the trials of its scenario."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from pathlib import Path

from protocol.codec import DecodeError, decode
from protocol.messages import Acknowledgement, Decision
from services.outbox import Outbox
from services.replay import replay_directory
from services.runtime.faults import Seen
from services.runtime.faulty_bus import FaultyHub
from services.runtime.journal import JournalError, verify
from services.runtime.timeline import Timeline, dice
from services.simulate.bystanders import MeddlerNode, OperatorNode, ViewerNode
from services.simulate.disk import Disk, DiskFaults
from services.simulate.nodes import (
    CROWD,
    KEYS,
    AggregatorNode,
    EnvironmentNode,
    LearnerNode,
    Node,
    TeacherNode,
)
from services.simulate.scenario import SESSION, Scenario, Trial, What
from services.teachers.scripted import ScriptedConfig

SECOND = 1_000_000_000
STORM_NS = 300 * SECOND
"""Faults end after so long: what is not finished then has to finish without them."""
CALM_NS = 300 * SECOND
"""Within so long after the faults a session is finished, or it stands still."""
HOUR_NS = 3_600 * SECOND
TAIL_NS = SECOND // 2
"""Faults go on for so long after the end was told: it must hold."""
QUIET_NS = 2 * SECOND
"""What is still on its way arrives within so long; the report is asked for after it."""
APPOINTMENTS_MAX = 50_000
"""A run that goes on for ever is cut off here; a long lesson may have so many for each hundred decisions."""
_FAULTS = frozenset({"lost", "again", "cut", "offline", "die", "stall"})
_DECISION = KEYS.decision(SESSION)
BEGINNING_WALL_NS = 1_700_000_000 * SECOND


@dataclass(slots=True)
class History:
    """What happened, as seen from outside: messages, files, reports and ends."""

    scenario: Scenario
    seen: list[Seen] = field(default_factory=list)
    data_dir: Path = Path()
    crowd_dir: Path | None = None
    """Where the aggregator's journal is, if there is an aggregator."""
    report: bytes | None = None
    """The last report, None when the session did not finish."""
    unacknowledged: dict[str, int] = field(default_factory=dict)
    """Answers that a living teacher still holds at the end."""
    died_of: list[str] = field(default_factory=list)
    problems: tuple[str, ...] = ()
    """What `verify` says about the journal."""
    replayed: tuple[str, bool] | None = None
    """Digest of the replay, and whether everything noted came out again."""
    appointments: int = 0
    faults: int = 0
    """Messages lost, doubled or cut off, processes ended or stopped, commits that failed."""
    trace_sha256: str = ""


class Stage:
    """A run from its beginning to its end."""

    def __init__(self, scenario: Scenario, root: Path) -> None:
        self._scenario = scenario
        self.history = History(scenario)
        self._digest = sha256()
        self.timeline = Timeline(BEGINNING_WALL_NS)
        seed = scenario.seed
        self.hub = FaultyHub(self.timeline, seed, scenario.faults, self._observe)
        disk_chance = dice(seed, "disk")
        self.disk = Disk(root, self.timeline, disk_chance, scenario.disk)
        self._trials = sorted(scenario.trials, key=lambda trial: trial.decision)
        lesson = scenario.lesson
        self.learner = LearnerNode(self.hub, seed, self.disk)
        self.environment = EnvironmentNode(self.hub, seed)
        self.operator = OperatorNode(self.hub, seed, lesson.config)
        self.teachers = {name: self._teacher(name) for name in lesson.teachers}
        self.meddler = MeddlerNode(self.hub, seed, faithful=lesson.exact)
        self._processes: dict[str, Node] = {
            "learner": self.learner, "environment": self.environment, **self.teachers
        }  # fmt: skip
        self.aggregator: AggregatorNode | None = None
        if lesson.crowd:
            disk = Disk(root / "crowd", self.timeline, dice(seed, "disk", "crowd"), scenario.disk)
            self.aggregator = self._processes["aggregator"] = AggregatorNode(self.hub, seed, disk)
        self._left: set[str] = set()
        self._appointments_max = APPOINTMENTS_MAX * (1 + lesson.config.episodes // 20)
        self._restarting: set[str] = set()
        self._finished = self._healed = False

    def _teacher(self, name: str) -> TeacherNode:
        lesson = self._scenario.lesson
        keys = CROWD if lesson.crowd else KEYS
        config = ScriptedConfig(SESSION, name, seed=11, parameters=lesson.faults, deployment=keys.deployment)
        return TeacherNode(self.hub, self._scenario.seed, config, Outbox())

    def play(self) -> History:
        """Run until the session is finished and everything is acknowledged, or nothing can come of it."""
        for node in (self.operator, *self._processes.values()):
            node.start()
        if self._scenario.viewer:
            ViewerNode(self.hub, "viewer", self._scenario.seed).start()
        if self._scenario.meddler:
            self.meddler.start()
        self._until(lambda: self._finished, STORM_NS)
        self._until(lambda: False, TAIL_NS)
        self._heal()
        self._until(self._settled, CALM_NS)
        if self._finished:
            self._until(lambda: False, QUIET_NS)
            self.operator.show()
            self._until(lambda: self.operator.report is not None, CALM_NS)
        return self._ended()

    def _until(self, reached: Callable[[], bool], span_ns: int) -> None:
        timeline, learner, aggregator = self.timeline, self.learner, self.aggregator
        end_ns = timeline.now_ns() + span_ns
        while not reached() and timeline.now_ns() < end_ns:
            if timeline.happened > self._appointments_max or not timeline.step():
                return
            if not learner.alive:
                self._restart_soon(learner)
            if aggregator is not None and not aggregator.alive:
                self._restart_soon(aggregator)

    def _settled(self) -> bool:
        return self._finished and all(
            node.done for name, node in self.teachers.items() if name not in self._left
        )

    def _restart_soon(self, node: Node) -> None:
        """Have a supervisor start the process again, once."""
        if node.name not in self._restarting:
            self._restarting.add(node.name)
            self.timeline.call_in(SECOND // 5, partial(self._restart, node))

    def _restart(self, node: Node) -> None:
        self._restarting.discard(node.name)
        node.start()

    def _heal(self) -> None:
        """End all faults and start what is dead; a disk that failed works again."""
        self.meddler.kill("leave")
        self.operator.resume()
        self._healed = True
        self.hub.heal()
        self.disk.faults = DiskFaults()
        if self.aggregator is not None:
            self.aggregator.disk.faults = DiskFaults()
        for node in self._processes.values():
            if node.bus in self.hub.buses:
                node.bus.set_online(online=True)
            if node.name not in self._left and not (isinstance(node, TeacherNode) and node.done):
                node.start()

    # ------------------------------------------------------------ what is seen, and what follows from it

    def _observe(self, seen: Seen) -> None:
        self.history.seen.append(seen)
        self._digest.update(
            f"{seen.at_ns} {seen.what} {seen.sender} {seen.receiver} {seen.key} {seen.ask} ".encode()
        )
        self._digest.update(seen.payload)
        if seen.what == "publish" and seen.key == _DECISION:
            self._on_decision(decode(seen.payload, Decision))
        elif seen.what == "answered" and "/answer/" in seen.key:
            self._on_acknowledgement(seen)

    def _on_decision(self, decision: Decision) -> None:
        self._finished = decision.phase == "finished"
        # What was meant for later than the end happens at the end.
        while self._trials and (self._finished or self._trials[0].decision <= decision.decision):
            trial = self._trials.pop(0)
            self.timeline.call_in(trial.after_ns, partial(self._try, trial))

    def _on_acknowledgement(self, seen: Seen) -> None:
        if not self._scenario.meddler or seen.receiver == "meddler":
            return
        try:
            decode(seen.payload, Acknowledgement)
        except DecodeError:
            return
        asked = next(one for one in reversed(self.history.seen) if one.what == "ask" and one.ask == seen.ask)
        self.meddler.acknowledged.append((seen.key, asked.payload))

    def _try(self, trial: Trial) -> None:
        if self._healed:
            return
        node = self._processes[trial.who]
        match trial.what:
            case What.KILL_LEARNER | What.KILL_ENVIRONMENT | What.KILL_TEACHER | What.KILL_AGGREGATOR:
                node.kill()
                self.timeline.call_in(trial.span_ns, partial(self._restart, node))
            case What.LEAVE:
                self._left.add(trial.who)
                node.kill()
            case What.STALL:
                node.stall(trial.span_ns)
            case What.CUT:
                if trial.who != trial.other:
                    self.hub.cut(trial.who, trial.other, trial.span_ns)
            case What.OFFLINE:
                self._take_off(node, trial.span_ns)
            case What.CLOCK:
                self.timeline.jump(HOUR_NS if trial.span_ns % 2 else -HOUR_NS)
            case What.PAUSE:
                self.operator.pause(trial.span_ns)

    def _take_off(self, node: Node, span_ns: int) -> None:
        bus = node.bus
        bus.set_online(online=False)
        self.timeline.call_in(span_ns, lambda: bus.set_online(online=True))

    # ------------------------------------------------------------ the end

    def _ended(self) -> History:
        history = self.history
        history.report = self.operator.report
        history.unacknowledged = {
            name: node.unacknowledged
            for name, node in self.teachers.items()
            if node.unacknowledged and name not in self._left
        }
        history.died_of = [line for node in self._processes.values() for line in node.died_of]
        self.learner.kill("leave")
        history.data_dir = self.disk.data_dir
        if self.aggregator is not None:
            self.aggregator.kill("leave")
            history.crowd_dir = self.aggregator.disk.data_dir
        history.appointments = self.timeline.happened
        history.faults = len(self.disk.fates) + sum(seen.what in _FAULTS for seen in history.seen)
        history.trace_sha256 = self._digest.hexdigest()
        try:
            history.problems = verify(history.data_dir).problems
            if history.crowd_dir is not None:
                history.problems += verify(history.crowd_dir).problems
            for one in replay_directory(history.data_dir, SESSION):
                history.replayed = (one.q_sha256, one.matches)
        except (JournalError, DecodeError) as error:
            history.problems = (*history.problems, str(error))
        return history
