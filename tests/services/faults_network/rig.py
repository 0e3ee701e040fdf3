"""A real deployment with bad weather between its processes, and teachers who are held to account."""

import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import Popen

from protocol.codec import decode
from protocol.journal import read_answer_body
from protocol.keys import Keys
from protocol.messages import Answer, CreateSession, WindowSpec, World
from services.client import AnswerState, AnswerUpdate, Client, Opened, Welcomed
from services.operator import Operator
from services.outbox import Outbox
from services.router import free_endpoint
from services.runtime.access import access_for
from services.runtime.clock import SystemClock
from services.runtime.journal import read_rows
from services.runtime.zenoh_bus import ZenohBus, open_bus
from services.topology import Role
from sfid_core.sokoban.levels import packaged
from tests.services.cli.command_line import running, wait_for
from tests.services.faults_network.weather import Proxy

KEYS = Keys()
ACTIONS = ("LEFT", "RIGHT", "UP", "DOWN")
UNTIL_ANSWERED = WindowSpec(mode="until-answered", span_ms=1_000)
CONNECT_MS = 15_000


def meant(decision: int) -> str:
    """Return what every teacher here answers: known from the decision's number alone."""
    return ACTIONS[decision * 7 % 4]


class Voice(threading.Thread):
    """A teacher over the real client: answers whatever is asked, and keeps what it was told."""

    def __init__(self, rig: "Rig", session: str, name: str, endpoint: str) -> None:
        super().__init__(name=name, daemon=True)
        self.acknowledged: dict[bytes, tuple[AnswerState, int]] = {}
        """By answer id: what became of it, and when that was known, on the steady clock."""
        self.waited_ms: list[float] = []
        """From the giving of each answer to its acknowledgement."""
        self.welcomes = 0
        self.unacknowledged = 0
        self.leave = threading.Event()
        self.quiet = threading.Event()
        """Set: answers nothing new."""
        self._rig, self._session, self._endpoint = rig, session, endpoint
        self._given: dict[bytes, int] = {}

    def run(self) -> None:
        bus = self._rig.bus(Role.TEACHER, self._endpoint)
        try:
            with Client(
                bus, KEYS, self._session, self.name, outbox=Outbox(), clock=SystemClock(), measures=False
            ) as client:
                while not self.leave.is_set():
                    self._hear(client, client.next(0.05))
                self.unacknowledged = client.drain(20.0)
        finally:
            bus.close()

    def _hear(self, client: Client, update: object) -> None:
        match update:
            case Opened(decision):
                asked = decision.phase == "asking" and not client.has_answered(decision)
                if asked and not self.quiet.is_set():
                    answer_id = client.answer(decision, action=meant(decision.decision))
                    self._given[answer_id] = time.monotonic_ns()
            case Welcomed():
                self.welcomes += 1
            case AnswerUpdate(answer_id=answer_id, state=AnswerState.SAVED | AnswerState.TOO_LATE as state):
                now_ns = time.monotonic_ns()
                self.acknowledged[answer_id] = (state, now_ns)
                if answer_id in self._given:
                    self.waited_ms.append((now_ns - self._given[answer_id]) / 1e6)


@dataclass
class Rig:
    """Router, environment and learner as processes; the two behind a proxy each."""

    data: Path
    access: Path
    router_endpoint: str
    learner_link: Proxy
    environment_link: Proxy
    stack: ExitStack
    processes: dict[str, "Popen[str]"] = field(default_factory=dict)

    @property
    def router_port(self) -> int:
        """Port of the real router, for further proxies."""
        return int(self.router_endpoint.rpartition(":")[2])

    def start(self, role: str) -> None:
        """Start a service and wait until it is ready."""
        access = ("--access", str(self.access))
        arguments = {
            "router": ("router", "--listen", self.router_endpoint, *access),
            "environment": ("environment", "--connect", self.environment_link.endpoint, *access),
            "learner": (
                "learner", "--connect", self.learner_link.endpoint, "--data", str(self.data), *access
            ),
        }[role]  # fmt: skip
        log = self.data.parent / f"{role}-{len(list(self.data.parent.glob(f'{role}-*.log')))}.log"
        self.processes[role] = self.stack.enter_context(running(*arguments, stderr=log))
        wait_for(f"{role} is ready", lambda: " ready" in log.read_text(), 60.0)

    def kill(self, role: str) -> None:
        """End a service without a word."""
        self.processes[role].kill()
        self.processes[role].wait()

    @contextmanager
    def stopped(self, role: str) -> Iterator[None]:
        """Hold a process still for the time of the block."""
        os.kill(self.processes[role].pid, signal.SIGSTOP)
        try:
            yield
        finally:
            os.kill(self.processes[role].pid, signal.SIGCONT)

    def bus(self, role: Role, endpoint: str | None = None) -> ZenohBus:
        """Return a bus of that role, to the router itself or through a proxy."""
        endpoint = endpoint or self.router_endpoint
        return open_bus(endpoint, CONNECT_MS, access=access_for(endpoint, role.value, self.access))

    def create(self, session: str, window: WindowSpec = UNTIL_ANSWERED, teachers_min: int = 1) -> None:
        """Create a session in the packaged room that does not end by itself."""
        world = World(level=packaged("room")[0].to_xsb(), level_name="room", steps_max=50)
        config = CreateSession(
            session=session, world=world, episodes=100_000, seed=3, window=window, teachers_min=teachers_min
        )
        bus = self.bus(Role.OPERATOR)
        try:
            Operator(bus, KEYS, patience_s=30).create(config)
        finally:
            bus.close()

    @contextmanager
    def teaching(self, session: str, count: int = 1, endpoint: str | None = None) -> Iterator[list[Voice]]:
        """Have so many teach for the time of the block; then they get their last acknowledgements."""
        endpoint = endpoint or self.router_endpoint
        voices = [Voice(self, session, f"{session}-{number}", endpoint) for number in range(count)]
        for voice in voices:
            voice.start()
        try:
            yield voices
        finally:
            for voice in voices:
                voice.leave.set()
            for voice in voices:
                voice.join(60)


def acknowledged(voices: list[Voice]) -> int:
    """Return how many answers of all of them are acknowledged."""
    return sum(len(voice.acknowledged) for voice in voices)


def more(voices: list[Voice], count: int) -> Callable[[], bool]:
    """Return a question: whether so many more answers are acknowledged than are now."""
    wanted = acknowledged(voices) + count
    return lambda: acknowledged(voices) >= wanted


@dataclass(frozen=True)
class Account:
    """What the journal of a session says beside what its teachers were told."""

    acknowledged: int
    lost: int
    """Acknowledged and not in the journal."""
    twice: int
    """In the journal more than once."""
    wrong: int
    """In the journal with another action, or as something else than its teacher was told."""
    applied_twice: int
    """Decisions for which two answers of one teacher count."""

    @property
    def sound(self) -> bool:
        """Whether every promise was kept."""
        return not (self.lost or self.twice or self.wrong or self.applied_twice)


def account(data: Path, session: str, voices: list[Voice]) -> Account:
    """Compare the journal with what its teachers were told."""
    rows: Counter[bytes] = Counter()
    codes: dict[bytes, str] = {}
    counted: Counter[tuple[str, int]] = Counter()
    names, wrong = {voice.name for voice in voices}, 0
    for row in read_rows(data, session):
        if row.kind != "answer" or row.body is None or row.unique is None:
            continue
        code, _, payload = read_answer_body(row.body)
        answer = decode(payload, Answer)
        rows[row.unique] += 1
        codes[row.unique] = code.value
        if answer.teacher not in names:
            continue
        wrong += answer.action != meant(answer.decision)
        counted[answer.teacher, answer.decision] += code.value == "accepted"
    told = {key: value for voice in voices for key, value in voice.acknowledged.items()}
    wrong += sum(
        (codes[key] == "accepted") is not (state is AnswerState.SAVED)
        for key, (state, _) in told.items()
        if key in codes
    )
    return Account(
        len(told),
        sum(key not in rows for key in told),
        sum(count > 1 for count in rows.values()),
        wrong,
        sum(count > 1 for count in counted.values()),
    )


@contextmanager
def deployed(root: Path) -> Iterator[Rig]:
    """Run a deployment below `root`."""
    endpoint = free_endpoint()
    port = int(endpoint.rpartition(":")[2])
    with ExitStack() as stack:
        learner_link, environment_link = (stack.enter_context(Proxy(port, seed)) for seed in (1, 2))
        rig = Rig(root / "data", root / "access", endpoint, learner_link, environment_link, stack)
        for role in ("router", "environment", "learner"):
            rig.start(role)
        yield rig
