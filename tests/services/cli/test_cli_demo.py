"""The whole system by its commands: what a run tells, that it repeats, and how it ends when it is told to."""

import json
import signal
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from services.replay import replay_directory
from services.router import free_endpoint
from services.runtime.journal import JournalError, read_rows
from tests.services.cli.command_line import Done, alive, kill, processes, running, sfid, wait_for

pytestmark = pytest.mark.real
RUN = ("demo", "--no-viewer", "--json", "--episodes", "5", "--seed", "11")
KEYS = {
    "session", "method", "level", "episodes", "labels", "teaching_seconds", "q_sha256", "data_dir",
    "recording", "processes",
}  # fmt: skip
EPISODE_KEYS = {
    "episode", "steps", "optimal_steps", "abs_td_error", "discounted_return", "discounted_env_return",
    "inputs", "outcome",
}  # fmt: skip


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The document of a run that nobody disturbed."""
    return document(tmp_path_factory.mktemp("first"))


def document(data: Path, *arguments: str) -> dict[str, Any]:
    done = sfid(*RUN, "--data", str(data), *arguments)
    assert done.code == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def rows_of(data: Path) -> int:
    """How many rows of a living journal are durable, 0 before there is one."""
    try:
        return sum(1 for _ in read_rows(data))
    except JournalError:
        return 0


def test_a_demo_tells_the_four_measures_the_labels_and_where_everything_is(first: dict[str, Any]) -> None:
    assert set(first) == KEYS
    assert [set(episode) for episode in first["episodes"]] == [EPISODE_KEYS] * 5
    assert [episode["episode"] for episode in first["episodes"]] == list(range(5))
    labels = first["labels"]
    parts = ("applied", "superseded", "late", "rejected", "pending")
    assert labels["submitted"] == sum(labels[part] for part in parts)
    assert labels["applied"] == sum(episode["inputs"] for episode in first["episodes"])
    assert (first["session"], first["method"], first["level"], first["recording"]) == (
        "demo", "sfid", "room", None,
    )  # fmt: skip
    assert {row["role"] for row in first["processes"]} == {
        "router", "environment", "learner", "teacher-oracle",
    }  # fmt: skip
    assert not any(alive(row["pid"]) for row in first["processes"])


def test_the_journal_of_a_demo_is_whole_and_rebuilds_its_table(first: dict[str, Any]) -> None:
    replayed = sfid("replay", first["data_dir"], "--verify", "--json")
    (row,) = json.loads(replayed.stdout)["sessions"]
    assert replayed.code == 0
    assert (row["session"], row["q_sha256"], row["matches"]) == ("demo", first["q_sha256"], True)
    verified = sfid("verify", first["data_dir"], "--json")
    assert verified.code == 0
    assert json.loads(verified.stdout) == {
        "ok": True, "sessions": 1, "labels": first["labels"]["submitted"], "problems": [],
    }  # fmt: skip


def test_a_demo_whose_learner_and_environment_are_killed_ends_as_if_they_had_not_been(
    first: dict[str, Any], tmp_path: Path
) -> None:
    data = tmp_path / "data"
    with running(*RUN, "--pace-ms", "5", "--data", str(data)) as demo:
        wait_for("some answers", lambda: rows_of(data) > 30)
        before = processes(data)
        kill(before["learner"])
        wait_for("another learner", lambda: processes(data)["learner"] != before["learner"])
        rows = rows_of(data)
        wait_for("more answers", lambda: rows_of(data) > rows + 20)
        kill(before["environment"])
        wait_for("another environment", lambda: processes(data)["environment"] != before["environment"])
        stdout, _ = demo.communicate(timeout=60)
    told = json.loads(stdout)
    assert demo.returncode == 0
    assert (told["q_sha256"], told["episodes"]) == (first["q_sha256"], first["episodes"])
    assert told["labels"] == first["labels"]
    assert [(one.q_sha256, one.matches) for one in replay_directory(data)] == [(first["q_sha256"], True)]


def test_two_teachers_teach_one_session_and_the_run_repeats_to_the_bit(tmp_path: Path) -> None:
    runs = [document(tmp_path / name, "--teacher", "expert,naive") for name in ("one", "two")]
    assert runs[0]["q_sha256"] == runs[1]["q_sha256"]
    assert runs[0]["episodes"] == runs[1]["episodes"]
    assert runs[0]["labels"] == runs[1]["labels"]
    assert {"teacher-expert", "teacher-naive"} <= {row["role"] for row in runs[0]["processes"]}


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_demo_that_is_interrupted_drains_in_five_seconds_and_leaves_nobody(
    tmp_path: Path, number: signal.Signals
) -> None:
    data = tmp_path / "data"
    with running(*RUN, "--pace-ms", "20", "--data", str(data)) as demo:
        wait_for("some answers", lambda: rows_of(data) > 10)
        pids = processes(data).values()
        demo.send_signal(number)
        stdout, _ = demo.communicate(timeout=5)
    assert (demo.returncode, stdout) == (130, "")
    assert len(pids) == 4
    assert not any(map(alive, pids))
    assert sfid("verify", str(data)).code == 0


@pytest.fixture
def endpoint() -> Iterator[str]:
    where = free_endpoint()
    with running("router", "--listen", where):
        yield where


def test_each_service_drains_on_sigterm_with_and_without_a_router(tmp_path: Path, endpoint: str) -> None:
    commands: dict[str, tuple[str, ...]] = {
        "environment": ("environment",),
        "learner": ("learner", "--data", str(tmp_path / "data")),
        "teacher": ("teach", "scripted", "--session", "s1"),
        "lonely": ("environment", "--verbose"),
    }
    for name, command in commands.items():
        where = free_endpoint() if name == "lonely" else endpoint
        errors = tmp_path / f"{name}.log"
        with running(*command, "--connect", where, stderr=errors) as service:
            if name == "lonely":
                wait_for("its handlers", lambda: catches_sigterm(service))
            else:
                wait_for(f"{name} is ready", lambda: "ready" in errors.read_text())  # noqa: B023 - as above
            service.terminate()
            assert service.wait(5) == 0, errors.read_text()
            assert "Traceback" not in errors.read_text()


def catches_sigterm(process: subprocess.Popen[str]) -> bool:
    """Tell whether the process has installed its handler yet: the kernel's mask of caught signals."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def test_a_supervised_set_serves_the_session_commands_and_drains(tmp_path: Path) -> None:
    where, config, errors = free_endpoint(), tmp_path / "sfid.toml", tmp_path / "up.log"
    config.write_text(f'listen = "{where}"\ndata = "{tmp_path / "data"}"\n[monitor]\nenabled = false\n')
    connect = ("--connect", where)
    with running("up", "--config", str(config), stderr=errors) as up:
        assert up.stdout is not None
        assert up.stdout.readline() == f"router at {where}, data in {tmp_path / 'data'}\n"
        created = sfid("session", "create", "maze", "--method", "q-learning", "--teachers-min", "0",
                       "--episodes", "3", *connect)  # fmt: skip
        watched = f"`sfid session show maze --connect {where}` shows how it does\n"
        told = f"session maze created: q-learning asks nobody: {watched}"
        assert created == Done(0, told, "")
        # Without --teachers-min: a method that asks nobody waits for nobody.
        same = sfid("session", "create", "maze", "--method", "q-learning", "--episodes", "3", *connect)
        assert same == Done(0, told.replace("created", "was there already, just so"), "")
        again = sfid("session", "create", "maze", "--seed", "5", *connect)
        assert (again.code, len(again.stderr.splitlines())) == (1, 1)
        wait_for("the end", lambda: show(connect)["phase"] == "finished")
        shown = show(connect)
        assert set(shown) == (KEYS - {"data_dir", "recording", "processes"}) | {
            "phase",
            "malformed",
            "failure",
        }
        (row,) = json.loads(sfid("session", "list", "--json", *connect).stdout)
        assert (row["session"], row["phase"], row["episode"]) == ("maze", "finished", 3)
        missing = sfid("session", "show", "other", *connect)
        assert (missing.code, len(missing.stderr.splitlines())) == (1, 1)
        pids = processes(tmp_path / "data").values()
        up.terminate()
        assert up.wait(5) == 0
    assert not any(map(alive, pids))
    assert stat.S_IMODE((tmp_path / "data").stat().st_mode) == 0o700
    assert "Traceback" not in errors.read_text()
    assert [one.q_sha256 for one in replay_directory(tmp_path / "data")] == [shown["q_sha256"]]


def show(connect: tuple[str, ...]) -> dict[str, Any]:
    """Return the document of the session."""
    told: dict[str, Any] = json.loads(sfid("session", "show", "maze", "--json", *connect).stdout)
    return told
