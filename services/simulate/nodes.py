"""The processes of a simulation: the services' own code, each with a bus and a turn instead of a thread."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from functools import partial

from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Refusal
from services.aggregator.config import AggregatorConfig
from services.aggregator.optima import Optima
from services.aggregator.service import Aggregator
from services.client import Client, Opened
from services.environment import Environment
from services.learner.config import LearnerConfig
from services.learner.service import Learner
from services.outbox import Outbox
from services.runtime.bus import Request
from services.runtime.faulty_bus import FaultyBus, FaultyHub
from services.runtime.timeline import dice
from services.simulate.disk import Disk, PowerCut, SimulatedShard
from services.simulate.scenario import MS, SESSION
from services.teachers.scripted import Script, ScriptedConfig, optimal_names

KEYS, CROWD = Keys("local"), Keys("local-crowd")
TICK_NS = 200 * MS
"""A learner looks at its clock so often when nothing comes, as its loop does."""
ASK_MS = 1_000
RETRY_NS = 100 * MS
_OPTIMAL = optimal_names()
"""Levels are few, and each is solved once."""


class Node(ABC):
    """One process: it lives, is stopped for a while, dies and is started again."""

    def __init__(self, hub: FaultyHub, name: str, seed: int) -> None:
        self.hub, self.name, self.seed = hub, name, seed
        self.timeline = hub.timeline
        self.alive = False
        self.lives = 0
        self.bus: FaultyBus
        self.died_of: list[str] = []
        self.chance = dice(seed, "node", name)
        self._wakes_ns: int | None = None
        self._stopped_until_ns = 0

    def start(self) -> None:
        """Begin a life."""
        if self.alive:
            return
        self.alive = True
        self.lives += 1
        self._wakes_ns = None
        self.chance = dice(self.seed, "node", self.name, str(self.lives))
        self.hub.see("start", self.name, "")
        self.bus = FaultyBus(self.hub, self.name, self.wake)
        self._survive(self.begin)
        self.wake()

    def kill(self, what: str = "die") -> None:
        """Die as by SIGKILL; `what` is how it is told."""
        if self.alive:
            self.alive = False
            self.hub.see(what, self.name, "")
            self.bus.kill()
            self.end()

    def stall(self, span_ns: int) -> None:
        """Do nothing for a while, as after SIGSTOP; what comes in waits."""
        self.hub.see("stall", self.name, "", payload=f"{span_ns / MS:.0f} ms".encode())
        self._stopped_until_ns = self.timeline.now_ns() + span_ns

    def wake(self) -> None:
        """Take a turn soon: some microseconds pass before a process gets to it."""
        self.wake_at(self.timeline.now_ns() + int((0.02 + 0.2 * self.chance.random()) * MS))

    def wake_at(self, at_ns: int) -> None:
        """Take a turn at that time, or before."""
        if self._wakes_ns is None or at_ns < self._wakes_ns:
            self._wakes_ns = at_ns
            self.timeline.call_at(at_ns, partial(self._woken, at_ns, self.lives))

    def _woken(self, at_ns: int, life: int) -> None:
        if not self.alive or life != self.lives or at_ns != self._wakes_ns:
            return
        self._wakes_ns = None
        if self.timeline.now_ns() < self._stopped_until_ns:
            self.wake_at(self._stopped_until_ns)
            return
        self._survive(self.turn)
        due_ns = self.due_ns()
        if due_ns is not None:
            self.wake_at(max(due_ns, self.timeline.now_ns() + 1_000))

    def _survive(self, act: Callable[[], None]) -> None:
        try:
            act()
        except PowerCut:
            self.kill()
        except Exception as error:  # noqa: BLE001 - whatever ends a process is evidence
            self.died_of.append(f"{self.name} died of {type(error).__name__}: {error}")
            self.kill()

    @abstractmethod
    def begin(self) -> None:
        """Declare everything on the new bus."""

    @abstractmethod
    def turn(self) -> None:
        """Do what is to be done now."""

    def due_ns(self) -> int | None:
        """When to take a turn though nothing comes."""
        return None

    def end(self) -> None:  # noqa: B027 - most hold nothing
        """Let go of what the process held."""


class LearnerNode(Node):
    """The learner service on a disk."""

    def __init__(self, hub: FaultyHub, seed: int, disk: Disk) -> None:
        super().__init__(hub, "learner", seed)
        self.disk = disk
        self._shard: SimulatedShard | None = None
        self._learner: Learner | None = None

    def begin(self) -> None:
        """See Node."""
        self._shard = self.disk.open()
        self._learner = Learner(LearnerConfig(self.disk.data_dir), self.bus, self._shard, self.timeline)
        self._learner.open()

    def turn(self) -> None:
        """See Node."""
        if self._learner is not None:
            self._learner.loop.turn(0.0)

    def due_ns(self) -> int | None:
        """See Node."""
        if self._learner is None:
            return None
        return self.timeline.now_ns() + int(self._learner.loop.wait_s(TICK_NS / 1e9) * 1e9) + 1

    def end(self) -> None:
        """See Node."""
        self.disk.cut()
        shard, self._shard, self._learner = self._shard, None, None
        if shard is not None:
            shard.abandon()


class AggregatorNode(Node):
    """The aggregator service on a disk of its own."""

    def __init__(self, hub: FaultyHub, seed: int, disk: Disk) -> None:
        super().__init__(hub, "aggregator", seed)
        self.disk = disk
        self._shard: SimulatedShard | None = None
        self._aggregator: Aggregator | None = None

    def begin(self) -> None:
        """See Node."""
        self._shard = self.disk.open()
        config = AggregatorConfig(self.disk.data_dir, solver=False)
        self._aggregator = Aggregator(
            config,
            self.bus,
            self._shard,
            self.timeline,
            optima=Optima(lambda work: work()),
            chance=self.chance,
        )
        self._aggregator.open()

    def turn(self) -> None:
        """See Node."""
        if self._aggregator is not None:
            self._aggregator.turn(0.0)

    def due_ns(self) -> int | None:
        """See Node."""
        return None if self._aggregator is None else self.timeline.now_ns() + TICK_NS // 10

    def end(self) -> None:
        """See Node."""
        self.disk.cut()
        shard, self._shard, self._aggregator = self._shard, None, None
        if shard is not None:
            shard.abandon()


class EnvironmentNode(Node):
    """The environment service: one request a turn."""

    def __init__(self, hub: FaultyHub, seed: int) -> None:
        super().__init__(hub, "environment", seed)
        self._inbox: deque[tuple[str, Request]] = deque()
        self._environment = Environment()

    def begin(self) -> None:
        """See Node."""
        self._inbox.clear()
        self._environment = Environment()
        for verb in ("begin", "execute"):
            self.bus.serve(KEYS.environment(verb), partial(self._enqueue, verb))
        self.bus.announce(KEYS.service("environment", "environment"))

    def _enqueue(self, verb: str, request: Request) -> None:
        self._inbox.append((verb, request))

    def turn(self) -> None:
        """See Node."""
        while self._inbox:
            verb, request = self._inbox.popleft()
            reply = self._environment.handle(verb, request.payload)
            if isinstance(reply, Refusal):
                request.reply_error(encode(reply))
            else:
                request.reply(encode(reply))


class TeacherNode(Node):
    """A scripted teacher behind the public client; the outbox outlives it, as a file does."""

    def __init__(self, hub: FaultyHub, seed: int, config: ScriptedConfig, outbox: Outbox) -> None:
        super().__init__(hub, config.teacher, seed)
        self._config, self._outbox = config, outbox
        self._client: Client | None = None
        self._script: Script | None = None

        self.done = False
        """Whether it left because the session is finished and nothing of its own is left to be told."""
        self._over = False

    @property
    def unacknowledged(self) -> int:
        """Answers that the learner has not acknowledged."""
        return len(self._outbox.pending())

    def begin(self) -> None:
        """See Node."""
        self.done = self._over = False
        self._client = Client(
            self.bus, Keys(self._config.deployment), SESSION, self.name,
            outbox=self._outbox, clock=self.timeline, measures=True, chance=self.chance,
        )  # fmt: skip
        self._script = Script(self._config, self._client.has_answered, optimal=_OPTIMAL)
        self._client.__enter__()

    def turn(self) -> None:
        """See Node."""
        client, script = self._client, self._script
        if client is None or script is None:
            return
        while True:
            while (update := client.next(0)) is not None:
                script.hear(update, self.timeline.now_ns())
                if isinstance(update, Opened):
                    self._over = self._over or update.decision.phase == "finished"
            said = script.speak(self.timeline.now_ns())
            if said is None:
                break
            silent = said.action is None and said.reward is None
            client.answer(
                said.decision, kind="abstain" if silent else None, action=said.action, reward=said.reward
            )
        if self._over and not self.unacknowledged:
            self.done = True
            client.close()
            self.kill("leave")

    def due_ns(self) -> int | None:
        """See Node."""
        if self._client is None or self._script is None:
            return None
        due_ns = self._client.due_ns
        return due_ns if self._script.due_ns is None else min(due_ns, self._script.due_ns)

    def end(self) -> None:
        """See Node."""
        self._client = self._script = None
