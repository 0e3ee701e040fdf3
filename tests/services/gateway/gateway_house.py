"""A gateway on a bus in memory with an honest small learner, and browsers that say what a test wants."""

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from protocol.identity import Identity, Role, sign
from services.gateway.config import GatewayConfig, Limits
from services.gateway.service import read_status, run
from services.runtime.memory_bus import MemoryBus, MemoryHub
from services.runtime.register import Register, new_token_id
from services.runtime.secret import load_secrets
from services.screens import Flow
from tests.services.teachers.fake_learner import FakeLearner

WAIT_S = 5.0
HOUR_S = 3600


class Browser:
    """One websocket, spoken to in frames; what comes is kept in order."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.frames: list[dict[str, Any]] = []

    def send(self, frame: str, /, **fields: Any) -> None:  # noqa: ANN401 - any JSON value
        self.socket.send(json.dumps({"type": frame, **fields}))

    def hello(self, token: str, nonce: str = "0" * 32, **arrival: str) -> "Browser":
        self.send("hello", version=1, token=token, nonce=nonce, arrival=arrival)
        return self

    def next(self, kind: str, wait_s: float = WAIT_S, **fields: Any) -> dict[str, Any]:  # noqa: ANN401
        """Return the next frame of a kind with these fields; others are kept in `frames`."""
        until = time.monotonic() + wait_s
        while True:
            frame = json.loads(self.socket.recv(timeout=max(0.001, until - time.monotonic())))
            self.frames.append(frame)
            if frame["type"] == kind and fields.items() <= frame.items():
                return dict(frame)

    def closed(self, wait_s: float = WAIT_S) -> int:
        """Wait for the end and return its code; what came before is kept."""
        until = time.monotonic() + wait_s
        while True:
            try:
                self.frames.append(json.loads(self.socket.recv(timeout=max(0.001, until - time.monotonic()))))
            except ConnectionClosed as closed:
                return closed.rcvd.code if closed.rcvd is not None else 1006

    def answer(self, number: int, decision: dict[str, Any], **changes: Any) -> str:  # noqa: ANN401
        """Answer a decision with UP and return the answer's id."""
        answer_id = f"{number:032x}"
        copied = ("session", "epoch", "decision", "episode", "step", "state")
        fields = {name: decision[name] for name in copied}
        self.send("answer", **({"id": answer_id, "kind": "label", "action": "UP"} | fields | changes))
        return answer_id


@dataclass
class Gateway:
    """The running gateway, and what a test asks of it."""

    config: GatewayConfig
    url: str
    hub: MemoryHub
    learner: FakeLearner
    stack: ExitStack
    bus: MemoryBus
    expires_s: int = field(default_factory=lambda: int(time.time()) + HOUR_S)

    @property
    def host(self) -> str:
        return self.url.partition("://")[2]

    def token(self, name: str = "ann", session: str = "s1", **changes: Any) -> str:  # noqa: ANN401
        fields: dict[str, Any] = {
            "session": session, "expires_s": self.expires_s, "token_id": new_token_id(),
        }  # fmt: skip
        identity = Identity(role=Role.TEACHER, pseudonym=name, **(fields | changes))
        return sign(identity, load_secrets(self.config.folder))

    def invitation(self, people: int, **changes: Any) -> str:  # noqa: ANN401 - any field
        fields: dict[str, Any] = {
            "session": "s1", "expires_s": self.expires_s, "token_id": new_token_id(),
        }  # fmt: skip
        identity = Identity(role=Role.INVITATION, people=people, **(fields | changes))
        return sign(identity, load_secrets(self.config.folder))

    def revoke(self, token_id: str) -> None:
        Register(self.config.folder).revoke(token_id)

    def browser(self, **options: Any) -> Browser:  # noqa: ANN401 - options of connect
        defaults: dict[str, Any] = {"origin": self.url, "compression": None, "proxy": None}
        address = f"ws://{self.host}/socket"
        return Browser(self.stack.enter_context(connect(address, **(defaults | options))))

    def teacher(self, name: str = "ann") -> tuple[Browser, dict[str, Any]]:
        """Return somebody who has joined, and the decision they see."""
        browser = self.browser().hello(self.token(name))
        return browser, browser.next("decision")

    def status(self, sure: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the status that the gateway wrote down, as soon as it is so."""
        until = time.monotonic() + WAIT_S
        tick = threading.Event()
        while not sure(found := read_status(self.config.data_dir)) and time.monotonic() < until:
            tick.wait(0.02)
        assert sure(found), found
        return found

    def refused(self, **expected: int) -> None:
        """Check how much was refused, by reason (with _ for -), and that nothing else was."""
        wanted = {reason.replace("_", "-"): count for reason, count in expected.items()}
        self.status(lambda found: found["refused"] == wanted)


@contextmanager
def gateway(data: Path, *, flow: Flow | None = None, **limits: Any) -> Iterator[Gateway]:  # noqa: ANN401
    """Yield a gateway in a thread of its own."""
    hub, ready, stop = MemoryHub(inline=True), threading.Event(), threading.Event()
    learner = FakeLearner(MemoryBus(hub))
    bus = MemoryBus(hub)
    config = GatewayConfig(data, listen="127.0.0.1:0", limits=Limits(**limits))
    thread = threading.Thread(target=run, args=(config, bus, lambda _: ready.set(), stop, flow))
    thread.start()
    try:
        assert ready.wait(WAIT_S)
        with ExitStack() as stack:
            yield Gateway(config, str(read_status(data)["url"]), hub, learner, stack, bus)
    finally:
        stop.set()
        thread.join(WAIT_S)
        with contextlib.suppress(RuntimeError):
            assert not thread.is_alive()
