"""How services do: every one of a real deployment answers, a hung or dead one does not."""

import json
import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from protocol.keys import KeyNameError, Keys
from services.operations.status import Board, ask, survey, understood
from services.router import free_endpoint
from services.runtime.bus import Reply
from services.runtime.clock import ManualClock
from services.runtime.journal import JournalFull, Shard
from services.runtime.memory_bus import MemoryBus, MemoryHub
from services.runtime.status import CommitMeter, StatusDesk
from tests.services.cli.command_line import processes, running, sfid, wait_for
from tests.services.learner.classroom import Classroom, session

KEYS = Keys()
MS = 1_000_000


def test_a_service_tells_what_it_counts_and_for_how_long_it_has_been_up() -> None:
    hub = MemoryHub(inline=True)
    clock = ManualClock()
    desk = StatusDesk("learner", "shard-0", clock, lambda: {"backlog": 3, "sessions": 2})
    MemoryBus(hub).serve(KEYS.status("learner", "shard-0"), desk.reply)
    clock.advance(1500 * MS)
    found = ask(MemoryBus(hub), KEYS, "learner", "shard-0")
    assert found.status is not None
    assert (found.ready, found.status.uptime_ms, found.status.backlog) == (True, 1500, 3)
    assert (found.status.sessions, found.status.pid) == (2, os.getpid())


def test_commits_are_counted_by_how_long_they_took() -> None:
    clock = ManualClock()
    meter = CommitMeter(clock)
    assert meter.facts()["last_commit_ms"] is None
    for took_us in (250, 251, 3_000, 2_000_000):
        began_ns = clock.now_ns()
        clock.advance(took_us * 1000)
        meter.took(began_ns)
    clock.advance(7 * MS)
    assert meter.facts() == {
        "ready": True, "reason": "",
        "commits": (1, 1, 0, 0, 1, 0, 0, 0, 0, 1), "commit_us": 2_003_501, "last_commit_ms": 7,
    }  # fmt: skip
    meter.failure = "nothing can be saved"
    assert {name: meter.facts()[name] for name in ("ready", "reason")} == {
        "ready": False, "reason": "nothing can be saved",
    }  # fmt: skip


def test_who_serves_is_known_by_tokens_and_who_is_expected_and_missing_is_named() -> None:
    hub = MemoryHub(inline=True)
    bus = MemoryBus(hub)
    bus.announce(KEYS.service("learner", "shard-0"))
    leave = bus.announce(KEYS.service("gateway", "0"))
    board = Board(MemoryBus(hub), [KEYS])
    assert board.names(0.05) == [(KEYS, "gateway", "0"), (KEYS, "learner", "shard-0")]
    leave()
    assert board.names(0.05) == [(KEYS, "learner", "shard-0")]
    bus.announce(KEYS.service("gateway", "0"))
    found = survey(MemoryBus(hub), [KEYS], ("environment", "learner"))
    assert [(one.role, one.name, one.ready, one.fault) for one in found] == [
        ("gateway", "0", False, "no answer within 2 s: it is not there, or its loop hangs"),
        ("learner", "shard-0", False, "no answer within 2 s: it is not there, or its loop hangs"),
        ("environment", "environment", False, "it is not there"),
    ]


def test_a_key_that_names_no_service_is_refused() -> None:
    with pytest.raises(KeyNameError, match="names no service"):
        KEYS.role_and_name(KEYS.decision("s1"))


class FullShard(Shard):
    """A shard whose disk is full."""

    def commit(self) -> None:
        raise JournalFull("the disk is full: free some")


def test_a_learner_that_cannot_write_its_journal_is_there_and_not_ready(tmp_path: Path) -> None:
    room = Classroom(tmp_path / "data", open_shard=FullShard.open)
    assert room.refused(KEYS.learner("create"), session()).code == "not-durable"
    replies: list[Reply | None] = []
    MemoryBus(room.hub).ask(KEYS.status("learner", "shard-0"), b"", replies.append, 1_000)
    room.settle()
    found = understood(KEYS, "learner", "shard-0", replies.pop())
    assert (found.ready, found.fault) == (False, "nothing can be saved: the disk is full: free some")
    assert found.status is not None
    room.shard.discard_pending()


@pytest.fixture
def deployment(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    """Everything but viewers, by `sfid up`: (data directory, endpoint)."""
    endpoint, data = free_endpoint(), tmp_path / "data"
    settings = tmp_path / "up.toml"
    settings.write_text(
        f"""data = "{data}"
listen = "{endpoint}"
[monitor]
viewer = false
[gateway]
enabled = true
listen = "127.0.0.1:0"
[aggregator]
enabled = true
"""
    )
    with ExitStack() as stack:
        up = stack.enter_context(
            running("--log-format", "json", "up", "--config", str(settings), stderr=tmp_path / "up.log")
        )
        assert up.stdout is not None
        while not (line := up.stdout.readline()).startswith("next: "):
            assert line, (tmp_path / "up.log").read_text()
        yield data, endpoint
        up.terminate()
        up.wait(30)


def services(endpoint: str) -> tuple[int, dict[str, dict[str, Any]]]:
    done = sfid("status", "--connect", endpoint, "--json")
    return done.code, {one["role"]: one for one in json.loads(done.stdout)["services"]}


@pytest.mark.real
def test_every_service_of_a_deployment_is_listed_and_a_stopped_one_is_not_well(
    deployment: tuple[Path, str],
) -> None:
    data, endpoint = deployment
    created = sfid("session", "create", "s1", "--connect", endpoint, "--level", "room", "--episodes", "2")
    assert created.code == 0, created.stderr
    code, found = services(endpoint)
    assert (code, sorted(found)) == (0, ["aggregator", "environment", "gateway", "learner", "monitor"])
    pids = processes(data)
    assert {role: one["pid"] for role, one in found.items()} == {role: pids[role] for role in found}
    learner = found["learner"]
    assert (learner["sessions"], learner["running"], sum(learner["commits"]) > 0) == (1, 1, True)
    for role in ("router", *found):
        assert sfid("health", role, "--connect", endpoint).code == 0
    os.kill(pids["environment"], signal.SIGSTOP)
    try:
        hung = sfid("health", "environment", "--connect", endpoint)
        assert (hung.code, hung.stderr.count("\n")) == (1, 1)
        assert "its loop hangs" in hung.stderr
    finally:
        os.kill(pids["environment"], signal.SIGCONT)
    back = ("health", "environment", "--connect", endpoint)
    wait_for("it is well again", lambda: sfid(*back).code == 0)


def documents(log: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in log.read_text().splitlines()]


@pytest.mark.real
def test_one_answer_is_followed_from_its_teachers_log_to_the_learners_and_the_journal(tmp_path: Path) -> None:
    endpoint, data, json_log = (
        free_endpoint(),
        tmp_path / "data",
        ("--log-format", "json", "--log-level", "debug"),
    )
    with ExitStack() as stack:
        up = stack.enter_context(
            running(
                *json_log, "up", "--data", str(data), "--listen", endpoint, "--no-viewer",
                stderr=tmp_path / "up.log",
            )
        )  # fmt: skip
        assert up.stdout is not None
        while not (line := up.stdout.readline()).startswith("next: "):
            assert line, (tmp_path / "up.log").read_text()
        common = ("--connect", endpoint)
        assert sfid("session", "create", "s1", *common, "--level", "room", "--episodes", "1").code == 0
        teacher = stack.enter_context(
            running(
                *json_log, "teach", "scripted", "--session", "s1", *common,
                stderr=tmp_path / "teacher.log",
            )
        )  # fmt: skip
        teacher.wait(60)
        up.terminate()
        up.wait(30)
    sent = [one for one in documents(tmp_path / "teacher.log") if one["message"].startswith("answer stored")]
    assert sent
    one = sent[len(sent) // 2]
    thread = {key: one[key] for key in ("session", "decision", "answer_id")}
    heard = [line for line in documents(tmp_path / "up.log") if line.get("answer_id") == thread["answer_id"]]
    assert [(line["role"], line["message"]) for line in heard] == [
        ("learner", "answer journaled as accepted")
    ]
    assert {key: heard[0][key] for key in thread} == thread
    said = json.loads(sfid("said", str(data), "--session", "s1", "--json").stdout)["said"]
    (row,) = [row for row in said if row["answer_id"] == thread["answer_id"]]
    assert (row["decision"], row["teacher"]) == (thread["decision"], one["teacher"])
