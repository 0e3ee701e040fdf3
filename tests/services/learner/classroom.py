"""A learner, an environment and teachers on one bus in memory, under a clock that the test moves."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import msgspec

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import (
    Acknowledgement,
    Answer,
    Control,
    CreateSession,
    Decision,
    Done,
    Episode,
    Join,
    Refusal,
    SessionQuery,
    SessionReport,
    Step,
    Welcome,
    WindowSpec,
    Wire,
    World,
)
from protocol.status_message import ServiceStatus
from services.environment import Environment
from services.learner.config import LearnerConfig
from services.learner.service import Learner
from services.runtime.bus import Received, Reply, Request
from services.runtime.clock import ManualClock
from services.runtime.journal import Row, Shard
from services.runtime.memory_bus import MemoryBus, MemoryHub
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.levels import packaged, parse_levels
from sfid_core.sokoban.solver import solve
from sfid_core.teaching.simulated import SimulatedTeacher

KEYS = Keys("local")
MS = 1_000_000
ROOM = packaged("room")[0].to_xsb()
ROOM_SOLUTION = solve(packaged("room")[0])
UNTIL_ANSWERED = WindowSpec(mode="until-answered", span_ms=1_000)
M = TypeVar("M", bound=Wire)


def session(**changes: Any) -> CreateSession:  # noqa: ANN401 - any field
    """Return the configuration of a short session in the packaged room."""
    world = World(level=ROOM, level_name="room", starts="4")
    config = CreateSession(session="s1", world=world, episodes=2, seed=7, window=UNTIL_ANSWERED)
    return msgspec.structs.replace(config, **changes)


def optimal(view: str) -> tuple[int, ...]:
    """Return the indexes of the actions that begin a shortest solution of a view of the room."""
    return tuple(int(action) for action in ROOM_SOLUTION.optimal_actions(parse_levels(view)[0].start))


class Speaker:
    """Somebody's end of the wire, small enough to see through: it joins, and sends answers."""

    keys: ClassVar[Keys] = KEYS
    response_ms: ClassVar[int | None] = None

    def __init__(self, room: "Classroom", name: str) -> None:
        self.room, self.name = room, name
        self.bus = MemoryBus(room.hub)
        self.withdraw: Callable[[], None] = lambda: None
        self.sent = 0

    def join(self, **changes: Any) -> Welcome:  # noqa: ANN401 - any field
        self.withdraw = self.bus.announce(self.keys.present("s1", self.name))
        message = Join(session="s1", teacher=self.name, **changes)
        return decode(self.room.ask(self.bus, self.keys.join("s1", self.name), message).payload, Welcome)

    def message(self, decision: Decision, **changes: Any) -> Answer:  # noqa: ANN401 - any field
        self.sent += 1
        answer = Answer(
            answer_id=self.name.encode()[:8].ljust(8, b"-") + self.sent.to_bytes(8, "big"),
            session="s1",
            teacher=self.name,
            epoch=decision.epoch,
            decision=decision.decision,
            episode=decision.episode,
            step=decision.step,
            state=decision.state,
            kind="label",
            response_ms=self.response_ms,
        )
        return msgspec.structs.replace(answer, **changes)

    def send(self, answer: Answer) -> Reply:
        return self.room.ask(self.bus, self.keys.answer("s1", self.name), answer)


class Pupil(Speaker):
    """A teacher's end of the wire."""

    def label(self, decision: Decision, action: str) -> Acknowledgement:
        return decode(self.send(self.message(decision, action=action)).payload, Acknowledgement)

    def control(self, verb: Any, window: WindowSpec | None = None) -> Reply:  # noqa: ANN401 - a literal
        message = Control(session="s1", teacher=self.name, verb=verb, window=window)
        return self.room.ask(self.bus, KEYS.control("s1", self.name), message)


@dataclass
class Classroom:
    """Everything of one deployment; `settle` runs it until nothing moves without the clock."""

    data_dir: Path
    open_shard: Callable[[Path], Shard] = Shard.open
    clock: ManualClock = field(default_factory=lambda: ManualClock(wall_ns=1_700_000_000_000_000_000))
    decisions: list[Decision] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    episodes: list[Episode] = field(default_factory=list)
    requests: int = 0
    tamper: Callable[[str, Wire], Wire | bytes] = lambda _verb, reply: reply

    def __post_init__(self) -> None:
        self.hub = MemoryHub(self.clock)
        self.watcher = MemoryBus(self.hub)
        self.watcher.subscribe(KEYS.decision(), self._see)
        self.watcher.subscribe(KEYS.measures(), self._see)
        self.environment = Environment()
        self.world_bus = MemoryBus(self.hub)
        for verb in ("begin", "execute"):
            self.world_bus.serve(KEYS.environment(verb), self._server(verb))
        self.start_learner()

    def start_learner(self) -> None:
        """Open a learner on the data directory."""
        self.shard = self.open_shard(self.data_dir)
        self.bus = MemoryBus(self.hub)
        self.learner = Learner(LearnerConfig(self.data_dir), self.bus, self.shard, self.clock)
        self.learner.open()
        self.settle()

    def kill_learner(self) -> None:
        """Leave it as `kill -9` does: what was not committed is gone, nothing is flushed or said."""
        self.bus.close()
        image = self.data_dir.with_name(self.data_dir.name + "-image")
        shutil.copytree(self.data_dir, image, ignore=shutil.ignore_patterns("*-shm"))
        self.shard.discard_pending()
        self.shard.close()
        shutil.rmtree(self.data_dir)
        image.rename(self.data_dir)

    def replace_environment(self) -> None:
        """Put an environment without any memory in the place of the one that runs."""
        self.environment = Environment()

    def settle(self) -> None:
        """Deliver and turn until nothing moves."""
        while self.hub.deliver_all() or self._turned():
            pass

    def _turned(self) -> bool:
        """Turn once, and tell whether that sent anything."""
        self.learner.loop.turn(0.0)
        return self.hub.deliver_all() > 0

    def pass_time(self, ms: int) -> None:
        """Move the clock, let timers fire and requests expire."""
        self.clock.advance(ms * MS)
        self.hub.expire_requests()
        self.settle()

    def ask(self, bus: MemoryBus, key: str, message: Wire | bytes) -> Reply:
        """Ask, and return the reply that must come."""
        replies: list[Reply | None] = []
        payload = message if isinstance(message, bytes) else encode(message)
        bus.ask(key, payload, replies.append, 60_000)
        self.settle()
        assert len(replies) == 1, f"{len(replies)} replies at {key}"
        assert replies[0] is not None
        return replies[0]

    def refused(self, key: str, message: Wire | bytes) -> Refusal:
        """Ask what must be refused, and return the refusal."""
        reply = self.ask(self.watcher, key, message)
        assert not reply.ok
        return decode(reply.payload, Refusal)

    def create(self, config: CreateSession | None = None) -> CreateSession:
        config = config or session()
        reply = self.ask(self.watcher, KEYS.learner("create"), config)
        assert decode(reply.payload, Done) == Done(ok=True)
        return config

    def report(self, name: str = "s1") -> SessionReport:
        query = SessionQuery(session=name)
        return decode(self.ask(self.watcher, KEYS.learner("show"), query).payload, SessionReport)

    def operate(self, verb: Any) -> Done:  # noqa: ANN401 - a literal
        message = Control(session="s1", teacher="operator", verb=verb)
        return decode(self.ask(self.watcher, KEYS.control("s1", "operator"), message).payload, Done)

    def rows(self, kind: str | None = None) -> list[Row]:
        """Return the rows of the journal, of one kind if it is named."""
        return [row for row in self.shard.rows() if kind in {None, row.kind}]

    def present(self) -> tuple[str, ...]:
        """Who is present, as the newest message tells it."""
        return self.decision.teachers

    @property
    def decision(self) -> Decision:
        """The decision as it stands, as the newest message tells it."""
        return self.decisions[-1]

    def teach(self, pupils: Mapping[Pupil, SimulatedTeacher], until: Callable[[], bool]) -> None:
        """Let teachers answer every decision once until `until`; each answer must bring the next."""
        while not until():
            decision = self.decision
            self.teach_once(pupils)
            assert self.decision is not decision, "the session stands still"

    def teach_once(self, pupils: Mapping[Pupil, SimulatedTeacher]) -> None:
        """Let teachers answer the decision as it stands, if it asks for anything."""
        decision = self.decision
        if decision.phase == "asking":
            for pupil, mind in pupils.items():
                pupil.send(self.opinion(pupil, mind, decision))

    def opinion(self, pupil: Pupil, mind: SimulatedTeacher, decision: Decision) -> Answer:
        """Return what a simulated teacher says about a decision; silence is an abstention."""
        number = decision.decision
        if decision.asked == "label":
            label = mind.label(number, decision.state, optimal(decision.view))
            if label is not None:
                return pupil.message(decision, action=Action(label).name)
        elif decision.action is not None:
            before = next(seen.view for seen in reversed(self.decisions)
                          if seen.decision == number and seen.phase == "executing")  # fmt: skip
            reward = mind.reward(number, decision.state, Action[decision.action], optimal(before))
            if reward is not None:
                return pupil.message(decision, kind="reward", reward=reward)
        return pupil.message(decision, kind="abstain")

    @property
    def finished(self) -> bool:
        return self.decision.phase == "finished"

    def _see(self, received: Received) -> None:
        if received.key.endswith("/decision"):
            self.decisions.append(decode(received.payload, Decision))
            return
        message: Step | Episode = decode(received.payload, Step | Episode)  # type: ignore[arg-type]
        if isinstance(message, Step):
            self.steps.append(message)
        else:
            self.episodes.append(message)

    def _server(self, verb: str) -> Callable[[Request], None]:
        def serve(request: Request) -> None:
            self.requests += 1
            reply = self.tamper(verb, self.environment.handle(verb, request.payload))
            if isinstance(reply, bytes):
                request.reply(reply)
            elif isinstance(reply, Refusal):
                request.reply_error(encode(reply))
            else:
                request.reply(encode(reply))

        return serve


def status(room: Classroom) -> ServiceStatus:
    """Ask the learner how it does."""
    replies: list[Reply | None] = []
    MemoryBus(room.hub).ask(KEYS.status("learner", "shard-0"), b"", replies.append, 1_000)
    room.settle()
    (reply,) = replies
    assert reply is not None
    assert reply.ok
    return decode(reply.payload, ServiceStatus)
