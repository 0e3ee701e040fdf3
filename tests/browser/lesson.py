"""A running deployment with a gateway, for tests that teach through a real browser."""

import json
import os
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from protocol.identity import Identity, Role, sign
from protocol.keys import Keys
from protocol.messages import CreateSession, SessionReport, WindowSpec, World
from services.cli.shared import launch
from services.gateway.service import read_status
from services.operator import Operator
from services.router import free_endpoint
from services.runtime.bus import Bus
from services.runtime.config import GatewaySection
from services.runtime.register import Register, new_token_id
from services.runtime.secret import load_secrets
from services.runtime.signals import Stop
from services.topology import Role as BusRole
from sfid_core.sokoban.levels import packaged

UNTIL_ANSWERED = WindowSpec(mode="until-answered", span_ms=1000)


@dataclass
class Lesson:
    """The services, and what a test asks of them."""

    data: Path
    endpoint: str
    url: str
    bus: Bus
    operator: Operator
    sessions: int = 0
    ids: dict[str, str] = field(default_factory=dict)

    def session(self, **changes: Any) -> str:  # noqa: ANN401 - any field of CreateSession
        """Create a session and return its name."""
        self.sessions += 1
        name = f"s{self.sessions}"
        world = World(level=packaged("room")[0].to_xsb(), level_name="room")
        fields: dict[str, Any] = {"world": world, "episodes": 5, "window": UNTIL_ANSWERED, "seed": 7}
        self.operator.create(CreateSession(session=name, **(fields | changes)))
        return name

    def link(self, session: str, name: str | None = "ann", *, people: int = 2, url: str | None = None) -> str:
        """Return a link for one person, or an invitation for several."""
        token_id = new_token_id()
        expires_s = int(time.time()) + 3600
        common = {"session": session, "expires_s": expires_s, "token_id": token_id}
        if name is None:
            identity = Identity(role=Role.INVITATION, people=people, **common)  # type: ignore[arg-type]
        else:
            identity = Identity(role=Role.TEACHER, pseudonym=name, **common)  # type: ignore[arg-type]
        self.ids[session] = token_id
        return f"{url or self.url}/#t={sign(identity, load_secrets(self.data / 'gateway'))}"

    def revoke(self, session: str) -> None:
        """Withdraw the last link to a session."""
        Register(self.data / "gateway").revoke(self.ids[session])

    def kill_gateway(self) -> None:
        """Kill the gateway; its supervisor starts it again."""
        processes = json.loads((self.data / "processes.json").read_text())
        os.kill(next(one["pid"] for one in processes if one["role"] == "gateway"), signal.SIGKILL)

    def report(self, session: str) -> SessionReport:
        """Return what the learner knows of a session."""
        return self.operator.show(session)[0]


@contextmanager
def lesson(data: Path) -> Iterator[Lesson]:
    """Yield real services in processes of their own."""
    with ExitStack() as stack:
        deployed = launch.Deployed(data, free_endpoint(), "local")
        supervisor = launch.supervise(data, launch.make_directories(data), Stop())
        stack.callback(supervisor.stop)
        supervisor.start(launch.router(deployed))
        gateway = launch.gateway(deployed, GatewaySection(enabled=True, listen=free_endpoint()[4:]))
        supervisor.start(launch.environment(deployed), launch.learner(deployed), gateway)
        bus = launch.bus(deployed, BusRole.OPERATOR)
        stack.callback(bus.close)
        url = str(read_status(data)["url"])
        yield Lesson(data, deployed.endpoint, url, bus, Operator(bus, Keys("local")))
