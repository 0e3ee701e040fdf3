"""A session taught through an aggregator over a real router by real processes (ring 3)."""

import json
import subprocess
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest

from protocol.crowd_journal import fold_crowd
from protocol.journal import Record, read_answer_body
from protocol.keys import Keys
from services.client import AnswerState, AnswerUpdate, Client, Opened
from services.outbox import Outbox
from services.router import free_endpoint
from services.runtime.clock import SystemClock
from services.runtime.journal import read_rows, verify
from services.runtime.zenoh_bus import open_bus
from tests.contract.router_process import router_process
from tests.services.cli.command_line import running, sfid, wait_for

pytestmark = pytest.mark.real


class Person(threading.Thread):
    """A teacher with the client class of page and terminal: answers until told to leave, or the end."""

    def __init__(self, endpoint: str, name: str) -> None:
        super().__init__(name=name, daemon=True)
        self.endpoint = endpoint
        self.leave = threading.Event()
        self.acknowledged: dict[bytes, str] = {}
        self.finished = False

    def run(self) -> None:
        bus = open_bus(self.endpoint, 5_000)
        client = Client(bus, Keys("local-crowd"), "s1", self.name, outbox=Outbox(), clock=SystemClock())
        with client:
            while not self.leave.is_set() and not self.finished:
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


@dataclass
class Deployment:
    """Router, environment, learner and aggregator as processes."""

    data: Path
    endpoint: str
    stack: ExitStack
    aggregator: "subprocess.Popen[str] | None" = None

    @property
    def crowd_dir(self) -> Path:
        return self.data / "crowd-crowd"

    def start(self, *command: str) -> "subprocess.Popen[str]":
        log = self.data / f"{command[0]}.log"
        return self.stack.enter_context(running(*command, "--connect", self.endpoint, stderr=log))

    def start_aggregator(self) -> None:
        self.aggregator = self.start("aggregate", "--data", str(self.data))

    def kill_aggregator(self) -> None:
        assert self.aggregator is not None
        self.aggregator.kill()
        self.aggregator.wait()

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
    endpoint = free_endpoint()
    with router_process(endpoint), ExitStack() as stack:
        made = Deployment(tmp_path, endpoint, stack)
        made.start("environment")
        made.start("learner", "--data", str(tmp_path))
        made.start_aggregator()
        yield made


def test_script_terminal_and_page_teach_one_session_through_an_aggregator_that_is_killed(
    deployment: Deployment,
) -> None:
    deployment.session("--episodes", "4", "--seed", "3")
    script = ("teach", "scripted", "--session", "s1", "--deployment", "local-crowd", "--name", "script")
    deployment.start(*script)
    helper = (*script[:-1], "second-script")
    deployment.start(*helper)
    page = Person(deployment.endpoint, "page")
    terminal = Person(deployment.endpoint, "terminal")
    page.start()
    terminal.start()
    wait_for("the crowd has begun", lambda: deployment.conclusions() >= 10)
    deployment.kill_aggregator()
    before = deployment.conclusions()
    deployment.start_aggregator()
    wait_for("the crowd goes on after a kill", lambda: deployment.conclusions() >= before + 5)
    page.leave.set()  # a member who leaves stops nobody
    wait_for("the session ends", lambda: terminal.finished, 60.0)
    terminal.join(10)
    page.join(10)
    wait_for("its end is durable", lambda: "finished" in {row.kind for row in deployment.crowd_rows()})
    _nothing_is_lost(deployment, page, terminal)
    _who_said_what(deployment)


def _nothing_is_lost(deployment: Deployment, *people: Person) -> None:
    codes: dict[bytes, list[str]] = {}
    for row in read_rows(deployment.crowd_dir):
        if row.kind == "answer" and row.body is not None and row.unique is not None:
            codes.setdefault(row.unique, []).append(read_answer_body(row.body)[0].value)
    for person in people:
        assert person.acknowledged
        for answer_id, state in person.acknowledged.items():
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
