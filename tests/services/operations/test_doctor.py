"""A doctor names what will not work, where, and the mend; and finds nothing where all is well."""

import json
import socket
import sqlite3
from pathlib import Path

import pytest

from protocol.keys import Keys
from services.operations.checks import Check, State
from services.operations.data_checks import data_checks, filesystem
from services.operations.machine_checks import machine_checks, misfits, packages
from services.operations.network_checks import is_taken, network_checks
from services.router import free_endpoint
from services.runtime.bus import Bus, BusError
from services.runtime.clock import SystemClock
from services.runtime.journal import Shard
from services.runtime.memory_bus import MemoryBus, MemoryHub
from services.runtime.secret import SecretError, load_secrets
from services.runtime.status import StatusDesk
from tests.services.cli.command_line import sfid


def by_name(checks: list[Check]) -> dict[str, Check]:
    return {check.name: check for check in checks}


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A sound data directory with a journal and a secret."""
    path = tmp_path / "data"
    with Shard.open(path) as shard:
        shard.append("s1", "answer", b"body", at_ns=1)
    load_secrets(path / "gateway")
    return path


def states(data: Path, *, prove: bool = False) -> dict[str, State]:
    return {check.name: check.state for check in data_checks(data, prove=prove)}


def test_where_all_is_well_nothing_is_to_be_mended(data: Path) -> None:
    found = by_name([*machine_checks(), *data_checks(data, prove=True)])
    faults = {name: check for name, check in found.items() if check.state is State.FAIL}
    assert faults == {}
    assert found["shard-0"].found == "1 rows, epoch 1, nobody writes it"
    assert found["proof"].found == "1 rows with 1 answers"
    assert found["secrets"].state is State.OK
    assert {"python", "packages", "sqlite", "open files", "clock", "space", "disk", "sync"} <= set(found)
    assert all(check.mend == "" for check in found.values() if check.state is State.OK)


def test_an_owner_of_the_journal_is_seen_and_left_alone(data: Path) -> None:
    with Shard.open(data) as shard:
        shard.append("s1", "answer", b"body", at_ns=2)
        shard.commit()
        assert by_name(list(data_checks(data)))["shard-0"].found == "2 rows, epoch 2, a process writes it"


def test_a_secret_that_others_can_read_fails_with_the_command_that_mends_it(data: Path) -> None:
    secret = data / "gateway" / "secret"
    secret.chmod(0o644)
    check = by_name(list(data_checks(data)))["secrets"]
    assert (check.state, f"chmod 600 {secret}" in check.mend) == (State.FAIL, True)


def test_folders_that_others_can_look_into_are_warned_of(data: Path) -> None:
    data.chmod(0o755)
    (data / "shard-0").chmod(0o750)
    found = states(data)
    assert (found["data"], found["shard-0"]) == (State.WARN, State.WARN)


def test_a_journal_of_a_newer_version_is_named_with_the_mend(data: Path) -> None:
    db = sqlite3.connect(data / "shard-0" / "journal.sqlite")
    db.execute("PRAGMA user_version = 99")
    db.close()
    check = by_name(list(data_checks(data)))["shard-0"]
    assert (check.state, "newer version" in check.found) == (State.FAIL, True)


def test_a_damaged_journal_fails_and_the_mend_is_said(data: Path) -> None:
    path = data / "shard-0" / "journal.sqlite"
    whole = path.read_bytes()
    path.write_bytes(b"spoilt" * 100)
    assert states(data)["shard-0"] is State.FAIL
    path.write_bytes(whole)
    mirror = data / "shard-0" / "journal.mirror"
    mirror.write_bytes(mirror.read_bytes()[:-20])
    assert states(data, prove=True)["proof"] in {State.FAIL, State.OK}
    spoilt = bytearray(mirror.read_bytes())
    spoilt[10] ^= 1
    mirror.write_bytes(spoilt)
    assert states(data, prove=True)["proof"] is State.FAIL


def test_what_repairs_and_erasings_left_is_warned_of(data: Path) -> None:
    (data / "shard-0" / "journal.sqlite.damaged-1").write_bytes(b"")
    assert states(data)["shard-0"] is State.WARN
    (data / "shard-0" / "erasing").write_text("{}")
    assert "sfid forget" in by_name(list(data_checks(data)))["shard-0"].mend


def test_a_directory_that_is_not_there_yet_is_no_fault_where_it_can_be_made(tmp_path: Path) -> None:
    found = by_name(list(data_checks(tmp_path / "not" / "yet")))
    assert (found["data"].state, "it will be made" in found["data"].found) == (State.OK, True)
    assert not (tmp_path / "not").exists()


def test_the_kind_of_file_system_is_that_of_the_innermost_mount() -> None:
    assert filesystem(Path("/proc/self")) == "proc"


def test_packages_that_are_missing_or_too_old_are_named() -> None:
    assert misfits("no-such-package>=1") == ["no-such-package is not installed"]
    assert misfits("pytest>=999") == [f"pytest {pytest.__version__} is installed, pytest>=999 is wanted"]
    assert misfits("pytest>=1,<1000") == []
    assert [check.state for check in packages("no-such-package")] == [State.FAIL]
    assert [check.state for check in packages("sfid")] == [State.OK]


def refusing(error: Exception) -> Bus:
    raise error


def network(endpoint: str, error: Exception) -> dict[str, Check]:
    return by_name(list(network_checks(endpoint, "local", lambda: refusing(error))))


def test_a_port_that_another_program_holds_fails_and_a_free_one_does_not() -> None:
    endpoint = free_endpoint()
    assert network(endpoint, BusError("no router"))["router"].state is State.OK
    with socket.socket() as other:
        other.bind(("127.0.0.1", int(endpoint.rpartition(":")[2])))
        other.listen()
        assert is_taken("127.0.0.1", int(endpoint.rpartition(":")[2]))
        check = network(endpoint, BusError("no router"))["router"]
    assert (check.state, "something else listens" in check.found) == (State.FAIL, True)
    assert network(endpoint, SecretError("no login"))["router"].state is State.FAIL


def test_services_behind_the_router_are_asked_how_they_do() -> None:
    hub, keys = MemoryHub(inline=True), Keys()
    bus = MemoryBus(hub)
    bus.announce(keys.service("learner", "shard-0"))
    desk = StatusDesk("learner", "shard-0", SystemClock(), lambda: {"ready": False, "reason": "no disk"})
    bus.serve(keys.status("learner", "shard-0"), desk.reply)
    found = by_name(list(network_checks("tcp/127.0.0.1:7447", "local", lambda: MemoryBus(hub))))
    assert found["router"].state is State.OK
    assert (found["learner shard-0"].state, found["learner shard-0"].found) == (State.FAIL, "no disk")
    assert network_states("other", hub) == {"router": State.OK, "services": State.WARN}


def network_states(deployment: str, hub: MemoryHub) -> dict[str, State]:
    found = network_checks("tcp/127.0.0.1:7447", deployment, lambda: MemoryBus(hub))
    return {check.name: check.state for check in found}


def test_the_command_says_a_line_a_check_and_its_exit_code_says_whether_all_is_well(data: Path) -> None:
    common = ("doctor", "--data", str(data), "--connect", free_endpoint())
    well = sfid(*common)
    assert (well.code, well.stderr) == (0, "")
    assert all(line.startswith(("ok ", "warn ", "fail ")) for line in well.stdout.splitlines())
    (data / "gateway" / "secret").chmod(0o604)
    ill = sfid(*common, "--json")
    told = json.loads(ill.stdout)
    assert (ill.code, told["well"], told["fail"]) == (1, False, 1)
    assert ill.stderr.startswith("sfid: not well: secrets")


def test_looking_changes_nothing(data: Path) -> None:
    before = {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in data.rglob("*.*")}
    list(data_checks(data, prove=True))
    assert {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in data.rglob("*.*")} == before
    assert {path.name for path in data.iterdir()} == {"gateway", "shard-0"}
