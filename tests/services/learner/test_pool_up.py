"""`sfid up` with several learners: one for each shard, and each comes back to its own."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from services.cli.shared.launch import Deployed, learner, learners
from services.learner.ownership import shard_of
from services.router import free_endpoint
from tests.services.cli.command_line import processes, running, sfid, wait_for

SHARDS = 2
NAMES = tuple(next(f"s{n}" for n in range(99) if shard_of(f"s{n}", SHARDS) == k) for k in range(SHARDS))


def test_one_shard_is_the_learner_as_it_was(tmp_path: Path) -> None:
    deployed = Deployed(tmp_path, "tcp/127.0.0.1:7447", "local")
    assert learners(deployed, 1) == (learner(deployed),)
    named = learners(deployed, 2)
    assert [one.name for one in named] == ["learner-0", "learner-1"]
    assert [one.arguments[-4:] for one in named] == [
        ("--shards", "2", "--shard", "0"),
        ("--shards", "2", "--shard", "1"),
    ]


@pytest.mark.parametrize(
    "flags,message",
    [
        (("--shards", "3", "--shard", "3"), "--shard 3: of 3 there are 0 to 2: pass --shards as well"),
        (("--shard", "1"), "--shard 1: of 1 there are 0 to 0: pass --shards as well"),
    ],
)
def test_a_shard_that_there_is_not_is_refused(flags: tuple[str, ...], message: str, tmp_path: Path) -> None:
    done = sfid("learner", "--data", str(tmp_path), *flags)
    assert (done.code, done.stderr) == (2, f"sfid: {message}\n")


@pytest.mark.real
def test_up_runs_a_learner_for_each_shard_and_one_that_is_killed_comes_back(tmp_path: Path) -> None:
    data, endpoint = tmp_path / "data", free_endpoint()
    config = tmp_path / "sfid.toml"
    config.write_text(
        f'data = "{data}"\nlisten = "{endpoint}"\n[learner]\nshards = {SHARDS}\n[monitor]\nenabled = false\n'
    )

    def shards() -> dict[str, Any]:
        told = sfid("status", "--connect", endpoint, "--json")
        found = json.loads(told.stdout)["services"] if told.stdout else []
        return {one["name"]: one for one in found if one["name"].startswith("shard-") and one["ready"]}

    with running("up", "--config", str(config), stderr=tmp_path / "up.log") as up:
        wait_for("both are there", lambda: set(shards()) == {"shard-0", "shard-1"}, 60)
        for name in NAMES:
            done = sfid("session", "create", name, "--connect", endpoint, "--level", "room")
            assert done.code == 0, done.stderr
        assert [one["sessions"] for one in shards().values()] == [1, 1]
        before = processes(data)
        os.kill(before["learner-1"], signal.SIGKILL)
        wait_for("it is started again", lambda: processes(data).get("learner-1") != before["learner-1"])
        wait_for("both are there again", lambda: set(shards()) == {"shard-0", "shard-1"}, 60)
        listed = sfid("session", "list", "--connect", endpoint, "--json")
        assert {one["session"] for one in json.loads(listed.stdout)} == set(NAMES)
        up.send_signal(signal.SIGTERM)
        assert up.wait(30) == 0
    assert sfid("verify", str(data)).code == 0
