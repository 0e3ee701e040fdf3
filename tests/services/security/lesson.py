"""A deployment that requires tokens, as processes of its own, and those who come to it."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import zenoh

from protocol.identity import Identity, check_key, sign
from protocol.identity import Role as TokenRole
from protocol.keys import Keys
from protocol.messages import CreateSession, WindowSpec, World
from services.cli.shared import launch
from services.client import AnswerState, AnswerUpdate, Client, Opened
from services.operator import Operator
from services.outbox import Outbox
from services.router import free_endpoint
from services.runtime.access import read_access
from services.runtime.clock import SystemClock
from services.runtime.register import new_token_id
from services.runtime.secret import load_secrets
from services.runtime.signals import Stop
from services.runtime.zenoh_config import client_config
from services.supervisor import Supervisor
from services.topology import Role
from sfid_core.sokoban.levels import packaged

KEYS = Keys("local")
SESSION = "s1"


@dataclass
class Lesson:
    """Router, environment and learner, and the operator's own connection."""

    deployed: launch.Deployed
    supervisor: Supervisor
    operator: Operator
    ids: dict[str, str] = field(default_factory=dict)

    @property
    def data(self) -> Path:
        """The data directory."""
        return self.deployed.data

    def pid(self, name: str) -> int:
        """Return the process id of a service."""
        return dict(self.supervisor.processes())[name]

    def secrets(self) -> tuple[bytes, ...]:
        """Return what signs the tokens of the deployment."""
        return tuple(load_secrets(self.data / "gateway"))

    def token(self, name: str) -> str:
        """Return a token for a teacher of the session, for an hour."""
        identity = Identity(
            role=TokenRole.TEACHER, session=SESSION, pseudonym=name, expires_s=int(time.time()) + 3600,
            token_id=new_token_id(),
        )  # fmt: skip
        self.ids[name] = identity.token_id
        return sign(identity, self.secrets())

    def raw(self, role: str) -> zenoh.Session:
        """Return a session of Zenoh's own with the login of a role: what an attacker may use."""
        return raw_session(
            self.deployed.endpoint, self.deployed.logins if self.deployed.guarded else None, role
        )


def raw_session(endpoint: str, folder: Path | None, role: str) -> zenoh.Session:
    """Return a session of Zenoh's own with the login of a role in that folder."""
    access = None if folder is None else read_access(folder, role)
    return zenoh.open(zenoh.Config.from_json5(json.dumps(client_config(endpoint, access=access))))


@contextmanager
def lesson(data: Path, *, guarded: bool = True) -> Iterator[Lesson]:
    """Yield a deployment with one session, whose window closes when one has answered."""
    with ExitStack() as stack:
        deployed = launch.Deployed(data, free_endpoint(), "local", require_tokens=True, guarded=guarded)
        supervisor = launch.supervise(data, launch.make_directories(data), Stop())
        stack.callback(supervisor.stop)
        supervisor.start(launch.router(deployed))
        supervisor.start(launch.environment(deployed), launch.learner(deployed))
        bus = launch.bus(deployed, Role.OPERATOR)
        stack.callback(bus.close)
        operator = Operator(bus, KEYS)
        world = World(level=packaged("room")[0].to_xsb(), level_name="room", starts="1")
        window = WindowSpec(mode="until-answered", span_ms=2_000, quorum=1)
        operator.create(CreateSession(session=SESSION, world=world, episodes=1_000_000, window=window))
        yield Lesson(deployed, supervisor, operator)


class Teacher(threading.Thread):
    """An honest teacher who answers every decision until told to leave."""

    def __init__(self, lesson: Lesson, name: str) -> None:
        super().__init__(name=name, daemon=True)
        self.leave = threading.Event()
        self.answering = threading.Event()
        self.acknowledged: set[bytes] = set()
        self.views: set[str] = set()
        self.disbelieved = 0
        self._lesson, self._token = lesson, lesson.token(name)

    def run(self) -> None:
        """Teach."""
        bus = launch.bus(self._lesson.deployed, Role.TEACHER)
        key = check_key(SESSION, self.name, self._lesson.secrets())
        with Client(
            bus, KEYS, SESSION, self.name, outbox=Outbox(), clock=SystemClock(), token=self._token,
            check_key=key,
        ) as client:  # fmt: skip
            while not self.leave.is_set():
                self._hear(client, client.next(0.1))
            client.drain(5.0)
        bus.close()

    def _hear(self, client: Client, update: object) -> None:
        match update:
            case Opened(decision):
                self.views.add(decision.view)
                if decision.phase == "asking" and not client.has_answered(decision):
                    client.answer(decision, action=decision.actions[decision.decision % 4])
            case AnswerUpdate(answer_id=answer_id, state=AnswerState.SAVED | AnswerState.TOO_LATE):
                self.acknowledged.add(answer_id)
                self.answering.set()
            case AnswerUpdate(reason="the acknowledgement is of something else"):
                self.disbelieved += 1
