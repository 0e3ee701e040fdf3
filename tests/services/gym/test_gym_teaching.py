"""Agents in Gymnasium environments, taught live by a script to the known optimum: real processes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from protocol.journal import Folded, Record, fold
from services.gym.digest import state_key
from services.gym.world import GymGround
from services.router import free_endpoint
from services.runtime.journal import JournalError, read_rows
from tests.services.cli.command_line import kill, processes, running, sfid, wait_for
from tests.services.gym.lakes import ICE

pytestmark = pytest.mark.real
RUN = ("demo", "--no-viewer", "--json", "--seed", "3")


def taught(data: Path, *arguments: str) -> dict[str, Any]:
    done = sfid(*RUN, "--data", str(data), *arguments)
    assert done.code == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    replayed = sfid("replay", str(data), "--verify", "--json")
    assert replayed.code == 0, replayed.stderr
    return told


def folded(data: Path) -> Folded:
    rows = (Record(row.kind, row.at_ns, row.body) for row in read_rows(data) if row.body is not None)
    found = fold(rows)
    assert found is not None
    return found


def test_a_lake_agent_is_taught_to_the_shortest_way(tmp_path: Path) -> None:
    told = taught(tmp_path, "--gym", "FrozenLake-v1", "--gym-option", "is_slippery=false", "--episodes", "15")
    last = [(row["steps"], row["optimal_steps"], row["outcome"]) for row in told["episodes"][-5:]]
    assert last == [(6, 6, "solved")] * 5
    assert told["level"] == "FrozenLake-v1 (is_slippery=False)"
    assert told["labels"]["applied"] == sum(row["steps"] for row in told["episodes"])


def test_a_taxi_agent_is_taught_to_ride_each_of_its_starts_in_the_fewest_steps(tmp_path: Path) -> None:
    told = taught(tmp_path, "--gym", "Taxi-v4", "--episodes", "32", "--starts", "4", "--reward-scale", "0.1")
    rides = [(row["steps"], row["outcome"]) for row in told["episodes"][-4:]]
    assert rides == [(row["optimal_steps"], "solved") for row in told["episodes"][-4:]]
    assert len({row["optimal_steps"] for row in told["episodes"]}) > 1


def test_an_agent_on_slippery_ice_is_taught_the_policy_that_arrives_most_often(tmp_path: Path) -> None:
    """Judged by the exact worth of what it learnt: 14 arrivals in 17, the most that this ice allows."""
    told = taught(tmp_path, "--gym", "FrozenLake-v1", "--episodes", "28")
    assert told["labels"]["applied"] == sum(row["steps"] for row in told["episodes"])
    learner = folded(tmp_path).session.learner
    table = GymGround(ICE, 0).table
    assert table is not None
    policy = np.array([int(np.argmax(learner.values(state_key(state)))) for state in range(16)])
    assert table.evaluate(policy, 1.0)[0] == pytest.approx(14 / 17, abs=1e-6)


def test_a_simulated_crowd_teaches_a_lake_that_it_is_told_of(tmp_path: Path) -> None:
    where, data, config = free_endpoint(), tmp_path / "data", tmp_path / "sfid.toml"
    config.write_text(f'listen = "{where}"\ndata = "{data}"\n[monitor]\nenabled = false\n')
    lake, connect = ("--gym", "FrozenLake-v1", "--gym-option", "is_slippery=false"), ("--connect", where)
    # Straight to the learner: several teachers of one session are what an aggregator hears, too.
    teach = ("teach", "crowd", "--session", "ice", "--mix", "expert:3", "--deployment", "local", *connect)
    with running("up", "--config", str(config), stderr=tmp_path / "up.log") as up:
        assert up.stdout is not None
        assert up.stdout.readline() == f"router at {where}, data in {data}\n"
        assert sfid("session", "create", "ice", "--episodes", "3", *lake, *connect).code == 0
        untold = sfid(*teach)
        assert untold.code == 2
        assert (
            "name it with the --gym and --gym-option that the session was" in untold.stderr.splitlines()[-1]
        )
        assert untold.stderr.count("sfid: ") == 1
        told = sfid(*teach, *lake, "--json")
        assert told.code == 0, told.stderr
    assert sum(one["accepted"] for one in json.loads(told.stdout)["workers"]) > 0


def test_an_environment_that_no_script_can_teach_is_told_before_anything_starts(tmp_path: Path) -> None:
    done = sfid(*RUN, "--data", str(tmp_path / "data"), "--gym", "Blackjack-v1")
    assert (done.code, done.stdout) == (2, "")
    assert done.stderr.splitlines()[-1] == (
        "sfid: environment Blackjack-v1 does not tell its transitions (env.unwrapped.P), so no script can "
        "solve it: let people teach it"
    )
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    "flags, reason",
    [
        (("--gym", "Taxi-v3"), "Please use `Taxi-v4` instead"),
        (("--gym-option", "is_slippery=false"), "name it with --gym"),
        (("--gym", "Taxi-v4", "--gym-option", "rainy"), "write NAME=VALUE"),
        (("--gym", "Taxi-v4", "--starts", "within:3"), "a number of starts, or all"),
        (("--gym", "Taxi-v4", "--gym-render", "ascii"), "choose text or picture"),
        (("--gym", "Taxi-v4", "--gym-actions", "UP,DOWN"), "2 names for the 6 actions"),
    ],
)
def test_a_mistake_in_the_flags_is_one_line_with_the_mend(flags: tuple[str, ...], reason: str) -> None:
    done = sfid("session", "create", "s1", *flags)
    assert (done.code, done.stdout) == (2, "")
    assert reason in done.stderr.splitlines()[-1]
    assert done.stderr.startswith("sfid: ")


def rows_of(data: Path) -> int:
    """How many rows of a living journal are durable, 0 before there is one."""
    try:
        return sum(1 for _ in read_rows(data))
    except JournalError:
        return 0


def test_an_environment_killed_on_the_ice_is_restored_with_its_chance_from_seed_and_actions(
    tmp_path: Path,
) -> None:
    ice = (*RUN, "--gym", "FrozenLake-v1", "--episodes", "6")
    undisturbed = json.loads(sfid(*ice, "--data", str(tmp_path / "calm")).stdout)
    data = tmp_path / "killed"
    with running(*ice, "--pace-ms", "5", "--data", str(data)) as demo:
        for rows in (10, 30):
            _kill_after(data, rows)
        told = json.loads(demo.communicate(timeout=60)[0])
    assert told["q_sha256"] == undisturbed["q_sha256"]
    assert [row["steps"] for row in told["episodes"]] == [row["steps"] for row in undisturbed["episodes"]]


def _kill_after(data: Path, rows: int) -> None:
    wait_for("some answers", lambda: rows_of(data) > rows, 60.0)
    before = processes(data)["environment"]
    kill(before)
    wait_for("another environment", lambda: processes(data)["environment"] != before)
