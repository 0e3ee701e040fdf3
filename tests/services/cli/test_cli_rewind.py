"""`sfid session rewind` on real processes: a lesson taken up again from an earlier episode."""

import json
from pathlib import Path
from typing import Any

import pytest

from services.router import free_endpoint
from tests.contract.router_process import router_process
from tests.services.cli.command_line import running, sfid

pytestmark = pytest.mark.real


def test_a_lesson_is_rewound_taught_on_and_proven_by_its_journal(tmp_path: Path) -> None:
    endpoint, data = free_endpoint(), tmp_path / "data"

    def told(*arguments: str) -> dict[str, Any]:
        done = sfid(*arguments, "--connect", endpoint)
        assert done.code == 0, done.stderr
        return json.loads(done.stdout) if "--json" in arguments else {}

    with (
        router_process(endpoint),
        running("environment", "--connect", endpoint),
        running("learner", "--connect", endpoint, "--data", str(data)),
    ):
        told("session", "create", "lesson", "--episodes", "3", "--window-mode", "until-answered")
        empty = sfid("session", "show", "lesson", "--connect", endpoint)
        told("teach", "scripted", "--session", "lesson", "--name", "ann")
        first = told("session", "show", "lesson", "--json")
        told("session", "rewind", "lesson", "--episode", "1", "--as", "second")
        waiting = told("session", "show", "second", "--json")
        stands = sfid("session", "show", "second", "--connect", endpoint).stdout.splitlines()
        told("session", "resume", "second")
        taught = sfid("teach", "scripted", "--session", "second", "--persona", "naive", "--connect", endpoint)
        second = told("session", "show", "second", "--json")
        beyond = sfid("session", "rewind", "lesson", "--episode", "9", "--connect", endpoint)
    assert (first["phase"], second["phase"]) == ("finished", "finished")
    assert [len(each["episodes"]) for each in (first, waiting, second)] == [3, 1, 3]
    assert first["episodes"][0]["steps"] == second["episodes"][0]["steps"]
    assert first["q_sha256"] != waiting["q_sha256"] != second["q_sha256"]
    assert empty.stdout.splitlines()[0] == "no episode is finished yet"
    assert " teacher-naive[" in taught.stderr
    assert stands[-1].startswith("phase paused, epoch 1, ")
    assert (beyond.code, beyond.stdout) == (1, "")
    assert "has not begun episode 9" in beyond.stderr.splitlines()[-1]
    replayed = sfid("replay", str(data), "--verify", "--json")
    assert replayed.code == 0, replayed.stderr
    assert sfid("verify", str(data)).code == 0
