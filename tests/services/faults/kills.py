"""Real processes killed by SIGKILL, at drawn moments and at chosen syncs, while teachers teach."""

import json
import logging
import os
import random
import shutil
import signal
import subprocess
import threading
import time
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Origin

from protocol.identity import Identity, Role, sign
from protocol.keys import Keys
from services.client import AnswerState, AnswerUpdate, Client, Opened
from services.gateway.config import GatewayConfig
from services.outbox import Outbox
from services.router import free_endpoint
from services.runtime.clock import SystemClock
from services.runtime.journal import read_rows, verify
from services.runtime.register import new_token_id
from services.runtime.secret import load_secrets
from services.runtime.zenoh_bus import open_bus
from tests.services.cli.command_line import SFID, sfid, wait_for
from tests.services.gateway.gateway_house import Browser

log = logging.getLogger("sfid.faults")
ROLES = ("learner", "learner", "learner", "aggregator", "aggregator", "environment", "gateway", "router")
"""Whom a round kills; those who keep a journal more often."""
AT_ONCE_MAX = 5
WITNESS = {"aggregator": "cyd", "gateway": "page"}
"""Whose next acknowledgement shows that the killed process serves again; else ann's does."""
BACK_S = 60.0
THINKS_S = 0.06
"""A page that answers faster than people do is refused as a flood."""
AGAIN_S = 1.0
"""After so long what is not acknowledged is sent again."""
SETTLED = {"saved", "too_late", "rejected"}


class Kills(NamedTuple):
    """What came of the kills."""

    kills: int
    by_role: dict[str, int]
    at_syncs: int
    acknowledged: int
    lost: int
    twice: int
    """Answers that stand, or count, more than once."""
    unproven: int
    """Journals that `verify` found fault with, or that replay to another Q than was live."""
    back_ms_median: int
    """From the kill to the next acknowledgement that needs the killed process."""
    back_ms_worst: int


class Teacher(threading.Thread):
    """A teacher with the client class of the terminal: answers everything that is asked."""

    def __init__(self, endpoint: str, name: str, session: str, deployment: str) -> None:
        super().__init__(name=name, daemon=True)
        self.endpoint, self.session, self.deployment = endpoint, session, deployment
        self.leave = threading.Event()
        self.acknowledged: set[bytes] = set()
        self.unacknowledged = 0

    def run(self) -> None:
        """Teach until told to leave and all is acknowledged."""
        bus = open_bus(self.endpoint, 10_000)
        keys, clock = Keys(self.deployment), SystemClock()
        with Client(bus, keys, self.session, self.name, outbox=Outbox(), clock=clock) as client:
            while not self.leave.is_set() or client.unacknowledged:
                self._hear(client, client.next(0.05))
                self.unacknowledged = client.unacknowledged
        bus.close()

    def _hear(self, client: Client, update: object) -> None:
        match update:
            case Opened(decision):
                asking = decision.phase == "asking" and not client.has_answered(decision)
                if asking and not self.leave.is_set():
                    client.answer(decision, action=decision.actions[decision.decision % 4])
            case AnswerUpdate(answer_id=answer_id, state=state) if state is not AnswerState.RETRYING:
                self.acknowledged.add(answer_id)


class Page(threading.Thread):
    """A browser's end of the gateway: comes back after each cut and sends again what was not acknowledged."""

    def __init__(self, data: Path, listen: str) -> None:
        super().__init__(name="page", daemon=True)
        self.data, self.listen = data, listen
        self.leave = threading.Event()
        self.acknowledged: set[bytes] = set()
        self._waiting: dict[str, dict[str, Any]] = {}
        self._answered = -1
        self._pace = threading.Event()
        identity = Identity(
            role=Role.TEACHER, pseudonym="page", session="s1", expires_s=int(time.time()) + 7_200,
            token_id=new_token_id(),
        )  # fmt: skip
        self._token = sign(identity, load_secrets(GatewayConfig(data).folder))

    @property
    def unacknowledged(self) -> int:
        """Answers that wait for their acknowledgement."""
        return len(self._waiting)

    def run(self) -> None:
        """Answer until told to leave and all is acknowledged."""
        while not self.leave.is_set() or self._waiting:
            try:
                self._visit()
            except (OSError, WebSocketException):
                self._pace.wait(0.1)

    def _visit(self) -> None:
        with connect(
            f"ws://{self.listen}/socket", origin=Origin(f"http://{self.listen}"), proxy=None
        ) as socket:
            browser = Browser(socket).hello(self._token)
            again_s, welcomed = 0.0, False
            while not self.leave.is_set() or self._waiting:
                frame = self._next(browser)
                welcomed = welcomed or bool(frame)
                if welcomed and time.monotonic() >= again_s:
                    again_s = time.monotonic() + AGAIN_S
                    for number, decision in list(self._waiting.items()):
                        browser.answer(int(number, 16), decision)
                self._hear(browser, frame)

    def _hear(self, browser: Browser, frame: dict[str, Any]) -> None:
        if frame.get("type") == "answer" and frame["state"] in SETTLED:
            if self._waiting.pop(frame["id"], None) is not None:
                self.acknowledged.add(bytes.fromhex(frame["id"]))
        elif (
            frame.get("phase") == "asking" and frame["decision"] > self._answered and not self.leave.is_set()
        ):
            self._answered = frame["decision"]
            self._pace.wait(THINKS_S)
            number = f"{frame['decision'] + 1:032x}"
            self._waiting[number] = frame
            browser.answer(frame["decision"] + 1, frame)

    def _next(self, browser: Browser) -> dict[str, Any]:
        try:
            frame: dict[str, Any] = json.loads(browser.socket.recv(timeout=0.1))
        except TimeoutError:
            return {}
        return frame


class House:
    """All processes of a deployment, each started again as soon as it is dead."""

    def __init__(self, data: Path, stack: ExitStack) -> None:
        self.data = data
        self.endpoint = free_endpoint()
        self.page_at = free_endpoint().removeprefix("tcp/")
        to, at = ("--connect", self.endpoint), ("--data", str(data))
        self._commands: dict[str, tuple[str, ...]] = {
            "router": ("router", "--listen", self.endpoint, "--open-to-all"),
            "learner": ("learner", *to, *at),
            "environment": ("environment", *to),
            "aggregator": ("aggregate", *to, *at, "--session", "s2"),
            "gateway": ("gateway", *to, *at, "--listen", self.page_at),
        }
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self.ended: Counter[str] = Counter()
        """Which processes ended by themselves, how often."""
        stack.callback(self.end)
        for role in self._commands:
            self.start(role)

    def start(self, role: str, *around: str) -> subprocess.Popen[bytes]:
        """Start a process, perhaps with a command around it."""
        with (self.data / f"{role}.log").open("ab") as log:
            process = subprocess.Popen(
                [*around, SFID, *self._commands[role]], stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                start_new_session=True,
            )  # fmt: skip
        self._running[role] = process
        return process

    def revive(self) -> None:
        """Start again what ended by itself, as `sfid up` does: who finds no router gives up."""
        for role, process in list(self._running.items()):
            if process.poll() is not None:
                self.ended[role] += 1
                self.start(role)

    def log(self, role: str) -> str:
        """Return the end of a process's log."""
        return "\n".join((self.data / f"{role}.log").read_text(errors="replace").splitlines()[-5:])

    def kill(self, role: str) -> None:
        """End the process without a word and start it again."""
        process = self._running[role]
        process.kill()
        process.wait(10)
        self.start(role)

    def die_at_sync(self, number: int) -> None:
        """Start the learner again so that it dies in that sync, wait until it has, and start it as it was."""
        strace = shutil.which("strace")
        assert strace is not None
        inject = f"inject=fdatasync,fsync:signal=KILL:when={number}"
        trace = ("-f", "-qq", "-o", "/dev/null", "-e", "trace=fdatasync,fsync", "-e", inject)
        self._end("learner")
        self.start("learner", strace, *trace).wait(BACK_S)
        self.start("learner")

    def _end(self, role: str) -> None:
        process = self._running.pop(role)
        with suppress(ProcessLookupError):  # its group: a tracer that dies alone leaves the traced behind
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(10)

    def end(self) -> None:
        """End everything."""
        for role in list(self._running):
            self._end(role)


def kill_and_look(kills: int, at_syncs: int, seed: int, data: Path) -> Kills:
    """Teach two sessions, one through an aggregator; kill so often, also at syncs; look at the end."""
    chance = random.Random(seed)
    with ExitStack() as stack:
        house = House(data, stack)
        teachers = _teaching(house)
        by_role: Counter[str] = Counter()
        back_ms: list[int] = []
        for number in range(at_syncs):
            house.die_at_sync(1 + number % 60)
            back_ms.append(_back(house, teachers, {"learner"}))
            log.info("%d deaths at a sync, %d ms", number + 1, back_ms[-1])
        while by_role.total() < kills:
            struck = set(chance.sample(ROLES, 1 + chance.randrange(AT_ONCE_MAX)))
            for role in sorted(struck):
                threading.Event().wait(chance.random() * 0.05)  # a drawn moment of whatever it does
                house.kill(role)
            by_role.update(struck)
            back_ms.append(_back(house, teachers, struck))
            log.info("%d kills, %d ms", by_role.total(), back_ms[-1])
        live = _stopped(house, teachers)
        house.end()
    told = {name: teacher.acknowledged for name, teacher in teachers.items()}
    lost, twice = _missing(data, told)
    back_ms.sort()
    return Kills(
        by_role.total() + at_syncs, dict(by_role), at_syncs, sum(map(len, told.values())), lost, twice,
        _unproven(data, live), back_ms[len(back_ms) // 2], back_ms[-1],
    )  # fmt: skip


def _teaching(house: House) -> "dict[str, Teacher | Page]":
    lasting = ("--window-mode", "until-answered", "--episodes", "100000", "--seed", "3", "--level", "room")
    for name in ("s1", "s2"):
        create = ("session", "create", name, "--connect", house.endpoint, *lasting)
        wait_for(name, lambda create=create: sfid(*create).code == 0)  # type: ignore[misc]
    teachers: dict[str, Teacher | Page] = {
        "ann": Teacher(house.endpoint, "ann", "s1", "local"),
        "cyd": Teacher(house.endpoint, "cyd", "s2", "local-crowd"),
        "page": Page(house.data, house.page_at),
    }
    for teacher in teachers.values():
        teacher.start()
    for name, teacher in teachers.items():
        wait_for(f"{name} is acknowledged", lambda teacher=teacher: bool(teacher.acknowledged), BACK_S)  # type: ignore[misc]
    return teachers


def _back(house: House, teachers: "dict[str, Teacher | Page]", struck: set[str]) -> int:
    """Wait until everybody who needs the struck processes is acknowledged anew; return ms."""
    began = time.monotonic()
    for name in sorted({WITNESS.get(role, "ann") for role in struck} | {"ann"}):
        _acknowledged_anew(house, teachers[name], struck)
    return round((time.monotonic() - began) * 1000)


def _acknowledged_anew(house: House, teacher: "Teacher | Page", struck: set[str]) -> None:
    before, deadline, pace = len(teacher.acknowledged), time.monotonic() + BACK_S, threading.Event()
    while len(teacher.acknowledged) <= before:
        house.revive()
        if time.monotonic() > deadline:
            logs = "\n".join(f"{role}: {house.log(role)}" for role in sorted(set(ROLES)))
            message = f"{teacher.name} is not acknowledged {BACK_S} s after a kill of {struck}\n{logs}"
            raise AssertionError(message)
        pace.wait(0.02)


def _stopped(house: House, teachers: "dict[str, Teacher | Page]") -> dict[str, str]:
    """Let everybody leave once all is acknowledged; return the live digests."""
    for teacher in teachers.values():
        teacher.leave.set()
    for name, teacher in teachers.items():
        teacher.join(BACK_S)
        assert not teacher.is_alive(), f"{name} still holds {teacher.unacknowledged} answers"
    live = {}
    for name in ("s1", "s2"):
        assert sfid("session", "stop", name, "--connect", house.endpoint).code == 0
        shown = sfid("session", "show", name, "--connect", house.endpoint, "--json")
        assert shown.code == 0, shown.stderr
        live[name] = json.loads(shown.stdout)["q_sha256"]
    return live


def _missing(data: Path, told: dict[str, set[bytes]]) -> tuple[int, int]:
    """Return how many acknowledged answers are not in their journal, and how many stand there twice."""
    learner = Counter(row.unique for row in read_rows(data) if row.kind == "answer")
    crowd = Counter(row.unique for row in read_rows(data / "crowd-crowd") if row.kind == "answer")
    lost = sum(answer not in learner for answer in told["ann"] | told["page"])
    lost += sum(answer not in crowd for answer in told["cyd"])
    return lost, sum(count > 1 for count in (*learner.values(), *crowd.values()))


def _unproven(data: Path, live: dict[str, str]) -> int:
    wrong: int = sum(not verify(directory).ok for directory in (data, data / "crowd-crowd"))
    done = sfid("replay", str(data), "--verify", "--json")
    replayed: dict[str, list[dict[str, Any]]] = json.loads(done.stdout)
    wrong += sum(
        not one["matches"] or one["q_sha256"] != live[one["session"]] for one in replayed["sessions"]
    )
    return wrong + sum(not one["matches"] for one in replayed["crowds"])
