"""A session taught through an aggregator over a real router by real processes (ring 3)."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect
from websockets.typing import Origin

from protocol.crowd_journal import fold_crowd
from protocol.identity import Identity, Role, sign
from protocol.journal import Record, read_answer_body
from protocol.keys import Keys
from services.client import AnswerState, AnswerUpdate, Client, Opened
from services.gateway.config import GatewayConfig
from services.gateway.service import read_status
from services.outbox import Outbox
from services.runtime.access import access_for
from services.runtime.clock import SystemClock
from services.runtime.journal import read_rows, verify
from services.runtime.register import new_token_id
from services.runtime.secret import load_secrets
from services.runtime.zenoh_bus import open_bus
from tests.services.aggregator.crowd_up import crowd_up
from tests.services.cli.command_line import kill, processes, running, sfid, wait_for
from tests.services.gateway.gateway_house import Browser

pytestmark = pytest.mark.real


class Terminal(threading.Thread):
    """A teacher with the client class of the terminal: answers until the end."""

    def __init__(self, endpoint: str) -> None:
        super().__init__(name="terminal", daemon=True)
        self.endpoint = endpoint
        self.acknowledged: dict[bytes, str] = {}
        self.finished = False

    def run(self) -> None:
        bus = open_bus(self.endpoint, 5_000, access=access_for(self.endpoint, "worker", None))
        keys = Keys("local-crowd")
        with Client(bus, keys, "s1", self.name, outbox=Outbox(), clock=SystemClock()) as client:
            while not self.finished:
                self._hear(client, client.next(0.1))
        bus.close()

    def _hear(self, client: Client, update: object) -> None:
        match update:
            case Opened(decision):
                self.finished = decision.phase == "finished"
                if decision.phase == "asking" and not client.has_answered(decision):
                    client.answer(decision, action=decision.actions[decision.decision % 4])
            case AnswerUpdate(answer_id=answer_id, state=AnswerState.SAVED | AnswerState.TOO_LATE as state):
                self.acknowledged[answer_id] = state.value


class Page(threading.Thread):
    """A browser's end of the gateway's websocket: answers until told to leave."""

    def __init__(self, data: Path) -> None:
        super().__init__(name="page", daemon=True)
        self.data = data
        self.leave = threading.Event()
        self.acknowledged: dict[bytes, str] = {}
        self.answered = -1

    def run(self) -> None:
        url = str(read_status(self.data)["url"])
        with connect(f"ws://{url.partition('://')[2]}/socket", origin=Origin(url), proxy=None) as socket:
            browser = Browser(socket).hello(self._token())
            while not self.leave.is_set():
                self._hear(browser, self._next(browser))

    def _hear(self, browser: Browser, frame: dict[str, Any]) -> None:
        if frame.get("type") == "answer" and frame["state"] in {"saved", "too_late"}:
            self.acknowledged[bytes.fromhex(frame["id"])] = frame["state"]
        elif frame.get("phase") == "asking" and frame["decision"] > self.answered:
            self.answered = frame["decision"]
            browser.answer(frame["decision"] + 1, frame)

    def _next(self, browser: Browser) -> dict[str, Any]:
        try:
            frame: dict[str, Any] = json.loads(browser.socket.recv(timeout=0.1))
        except TimeoutError:
            return {}
        return frame

    def _token(self) -> str:
        identity = Identity(
            role=Role.TEACHER, pseudonym="page", session="s1", expires_s=int(time.time()) + 3600,
            token_id=new_token_id(),
        )  # fmt: skip
        return sign(identity, load_secrets(GatewayConfig(self.data).folder))


@dataclass
class Deployment:
    """Everything by `sfid up`, but the viewer."""

    data: Path
    endpoint: str
    stack: ExitStack

    @property
    def crowd_dir(self) -> Path:
        return self.data / "crowd-crowd"

    def start(self, *command: str) -> None:
        log = self.data / f"{command[1]}.log"
        self.stack.enter_context(running(*command, "--connect", self.endpoint, stderr=log))

    def kill_aggregator(self) -> None:
        pid = processes(self.data)["aggregator"]
        kill(pid)
        wait_for("it is started again", lambda: processes(self.data).get("aggregator", pid) != pid)

    def session(self, *flags: str) -> None:
        common = ("--connect", self.endpoint, "--level", "room")
        done = sfid("session", "create", "s1", *common, "--window-mode", "until-answered", *flags)
        assert done.code == 0, done.stderr

    def crowd_rows(self) -> list[Record]:
        rows = read_rows(self.crowd_dir)
        return [Record(row.kind, row.at_ns, row.body) for row in rows if row.body is not None]

    def conclusions(self) -> int:
        """How many rounds are durable, 0 before there is a journal."""
        if not (self.crowd_dir / "shard-0" / "journal.sqlite").exists():
            return 0
        return sum(record.kind == "closed" for record in self.crowd_rows())


@pytest.fixture
def deployment(tmp_path: Path) -> Iterator[Deployment]:
    with ExitStack() as stack:
        yield Deployment(tmp_path, stack.enter_context(crowd_up(tmp_path)), stack)


def test_page_terminal_and_script_teach_one_session_through_an_aggregator_that_is_killed(
    deployment: Deployment,
) -> None:
    deployment.session("--episodes", "4", "--seed", "3")
    script = ("teach", "scripted", "--session", "s1", "--deployment", "local-crowd", "--name")
    deployment.start(*script, "script")
    deployment.start(*script, "second-script")
    page, terminal = Page(deployment.data), Terminal(deployment.endpoint)
    page.start()
    terminal.start()
    wait_for("the crowd has begun", lambda: deployment.conclusions() >= 10)
    deployment.kill_aggregator()
    before = deployment.conclusions()
    wait_for("the crowd goes on after a kill", lambda: deployment.conclusions() >= before + 5)
    page.leave.set()  # a member who leaves stops nobody
    wait_for("the session ends", lambda: terminal.finished, 60.0)
    terminal.join(10)
    page.join(10)
    assert (terminal.is_alive(), page.is_alive()) == (False, False)
    wait_for("its end is durable", lambda: "finished" in {row.kind for row in deployment.crowd_rows()})
    _nothing_is_lost(deployment, terminal.acknowledged, page.acknowledged)
    _who_said_what(deployment)
    _everything_replays(deployment)


def _everything_replays(deployment: Deployment) -> None:
    done = sfid("replay", str(deployment.data), "--verify", "--json")
    assert done.code == 0, done.stderr
    told = json.loads(done.stdout)
    (crowd,) = told["crowds"]
    assert [one["matches"] for one in (*told["sessions"], crowd)] == [True, True]
    assert [one["worker"] for one in crowd["workers"]] == ["page", "script", "second-script", "terminal"]
    assert all(0 < one["reliability"] < 1 and one["standard_error"] > 0 for one in crowd["workers"])


def _nothing_is_lost(deployment: Deployment, *people: dict[bytes, str]) -> None:
    codes: dict[bytes, list[str]] = {}
    for row in read_rows(deployment.crowd_dir):
        if row.kind == "answer" and row.body is not None and row.unique is not None:
            codes.setdefault(row.unique, []).append(read_answer_body(row.body)[0].value)
    for acknowledged in people:
        assert acknowledged
        for answer_id, state in acknowledged.items():
            assert len(codes[answer_id]) == 1, "an acknowledged answer is in the journal, once"
            assert (codes[answer_id][0] == "accepted") is (state == "saved")
    folded = fold_crowd(deployment.crowd_rows())
    assert folded is not None
    assert (folded.mismatches, folded.finished) == ([], True)
    assert verify(deployment.crowd_dir).ok


def _who_said_what(deployment: Deployment) -> None:
    done = sfid("said", str(deployment.data), "--session", "s1", "--json")
    assert done.code == 0, done.stderr
    said = json.loads(done.stdout)["said"]
    learner = {row["answer_id"]: row for row in said if not row["via"]}
    crowd = [row for row in said if row["via"] == "crowd"]
    assert {row["teacher"] for row in crowd} == {"script", "second-script", "page", "terminal"}
    assert {row["teacher"] for row in learner.values()} == {"crowd"}
    counted = [row for row in crowd if row["handed_on_as"]]
    # Every conclusion that has an answer in it reached the learner, and for the decision it was given for.
    assert {learner[row["handed_on_as"]]["decision"] == row["decision"] for row in counted} == {True}
    assert {learner[row["handed_on_as"]]["code"] for row in counted} == {"accepted"}
    for row in crowd:
        assert row["asked_at_ns"] <= row["shown_ns"][1] <= row["arrived_at_ns"]
        assert row["shown_ns"][0] <= row["answered_ns"][1]


def test_a_simulated_crowd_teaches_over_the_router(deployment: Deployment) -> None:
    deployment.session("--episodes", "3")
    mix = ("--mix", "good:6,random:3,adversary:1", "--workers", "10", "--seed", "4")
    done = sfid("teach", "crowd", "--session", "s1", "--connect", deployment.endpoint, *mix, "--json")
    assert done.code == 0, done.stderr
    workers = json.loads(done.stdout)["workers"]
    assert [row["kind"] for row in workers] == ["good"] * 6 + ["random"] * 3 + ["adversary"]
    assert {row["unacknowledged"] for row in workers} == {0}
    folded = fold_crowd(deployment.crowd_rows())
    assert folded is not None
    assert folded.crowd.conclusions == workers[0]["accepted"]
