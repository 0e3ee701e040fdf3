"""The supervisor with real children: the dead run again, the unfit are told of, nobody stays behind."""

import logging
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from services.router import free_endpoint
from services.runtime.signals import Stop
from services.supervisor import RESTARTS_MAX, Service, Supervisor, SupervisorError, write_processes
from tests.services.cli.command_line import alive, wait_for

pytestmark = pytest.mark.real


@pytest.fixture
def told() -> list[list[tuple[str, int]]]:
    """Every list of processes that the supervisor has told of."""
    return []


@pytest.fixture
def supervisor(tmp_path: Path, told: list[list[tuple[str, int]]]) -> Iterator[Supervisor]:
    made = Supervisor(tmp_path, told.append)
    yield made
    made.stop()


def router(endpoint: str, name: str = "router") -> Service:
    return Service(name, ("router", "--listen", endpoint))


def test_a_killed_child_runs_again_and_the_log_says_so(
    supervisor: Supervisor, told: list[list[tuple[str, int]]], caplog: pytest.LogCaptureFixture
) -> None:
    endpoint = free_endpoint()
    assert supervisor.start(router(endpoint)) == {"router": endpoint}
    ((_, first),) = supervisor.processes()
    with caplog.at_level(logging.WARNING, "sfid.supervisor"):
        os.kill(first, signal.SIGKILL)
        wait_for("another router", lambda: len(told) == 2)
    ((name, second),) = supervisor.processes()
    assert (name, second != first, told) == ("router", True, [[("router", first)], [("router", second)]])
    assert caplog.messages == [
        f"router (pid {first}) was ended by SIGKILL: starting it again",
        f"router runs again (pid {second})",
    ]
    supervisor.check()


def test_a_child_that_keeps_dying_is_given_up(supervisor: Supervisor) -> None:
    supervisor.start(router(free_endpoint()))
    killed: set[int] = set()

    def given_up() -> bool:
        for _, pid in supervisor.processes():
            if pid not in killed and alive(pid):
                os.kill(pid, signal.SIGKILL)
                killed.add(pid)
        try:
            supervisor.check()
        except SupervisorError:
            return True
        return False

    wait_for("giving up", given_up)
    with pytest.raises(SupervisorError, match=r"router was ended by SIGKILL and was restarted 8 times"):
        supervisor.check()
    assert len(killed) == RESTARTS_MAX + 1
    assert not any(map(alive, killed))


def test_a_child_that_cannot_start_ends_its_company_and_passes_on_its_line_and_code(
    supervisor: Supervisor, told: list[list[tuple[str, int]]], tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(SupervisorError) as refused:
            supervisor.start(router(free_endpoint(), "good"), router(endpoint, "bad"))
    assert (refused.value.exit_code, str(refused.value)) == (
        2,
        f"cannot listen at {endpoint}: another program has it, stop that one or pass another --listen",
    )
    ended = dict(supervisor.processes())
    assert set(ended) == {"good", "bad"}
    assert not any(map(alive, ended.values()))
    assert told == []
    assert (tmp_path / "good.log").exists()


def test_children_drain_when_their_supervisor_is_killed(tmp_path: Path) -> None:
    command = [sys.executable, str(Path(__file__).with_name("child.py")), str(tmp_path), free_endpoint()]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        name, pid = process.stdout.readline().split()
        assert (name, alive(int(pid))) == ("router", True)
        process.kill()
        wait_for("the child is gone", lambda: not alive(int(pid)), 5)


def test_stopping_ends_the_named_ones_or_everybody_and_keeps_who_they_were(
    supervisor: Supervisor, tmp_path: Path
) -> None:
    supervisor.start(router(free_endpoint(), "one"), router(free_endpoint(), "two"))
    pids = dict(supervisor.processes())
    supervisor.stop(["two"])
    assert (alive(pids["one"]), alive(pids["two"])) == (True, False)
    supervisor.stop()
    assert not alive(pids["one"])
    assert dict(supervisor.processes()) == pids
    supervisor.check()
    write_processes(tmp_path / "processes.json", [("one", 1)])
    assert (tmp_path / "processes.json").read_text() == '[{"role": "one", "pid": 1}]\n'
    assert not (tmp_path / "processes.part").exists()


def test_who_is_wanted_no_more_is_not_waited_for(tmp_path: Path) -> None:
    stop = Stop()
    supervisor = Supervisor(tmp_path, wanted_no_more=stop)
    log = tmp_path / "lonely.log"
    waits_for_a_router = Service("lonely", ("environment", "--connect", free_endpoint(), "--verbose"))

    def lose_interest() -> None:
        wait_for("its start", log.exists)
        stop.set()

    threading.Thread(target=lose_interest).start()
    try:
        with pytest.raises(KeyboardInterrupt):
            supervisor.start(waits_for_a_router)
    finally:
        supervisor.stop()
    ((name, pid),) = supervisor.processes()
    assert (name, alive(pid)) == ("lonely", False)


def test_a_disk_that_cannot_note_who_runs_does_not_end_the_watch(tmp_path: Path) -> None:
    restarted = threading.Event()
    calls: list[int] = []

    def full(processes: list[tuple[str, int]]) -> None:
        calls.append(processes[0][1])
        if len(calls) == 2:
            restarted.set()
        raise OSError("no space left")

    supervisor = Supervisor(tmp_path, full)
    try:
        supervisor.start(router(free_endpoint()))
        os.kill(calls[0], signal.SIGKILL)
        assert restarted.wait(30)
        supervisor.check()
    finally:
        supervisor.stop()
    assert not any(map(alive, calls))
