"""Each role may do what the topology says, and nothing else: through a real router."""

import json
import queue
import random
import socket
import stat
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from protocol.keys import Keys
from services.router import RouterConfig, free_endpoint, run
from services.runtime.access import Access, note_router, noted_folder, read_access
from services.runtime.bus import BusError, Presence, Received, Reply, Request
from services.runtime.endpoint import split_endpoint
from services.runtime.secret import SecretError
from services.runtime.zenoh_bus import ZenohBus, open_bus
from services.topology import Role, access_control, topology
from tests.contract.router_process import router_process
from tests.services.cli.command_line import running, sfid, wait_for

pytestmark = pytest.mark.real
KEYS, CROWD = Keys("local"), Keys("local-crowd")
DEADLINE_S = 10.0
GARBAGE = 500


class Network:
    """A router process with logins, and a bus for each role that a test needs."""

    router: subprocess.Popen[str]

    def __init__(self, folder: Path) -> None:
        self.folder, self.endpoint = folder, free_endpoint()
        self._buses: dict[Role, ZenohBus] = {}
        self._rogues: list[ZenohBus] = []

    def bus(self, role: Role) -> ZenohBus:
        if role not in self._buses:
            self._buses[role] = self._open(role)
        return self._buses[role]

    def rogue(self, role: Role) -> ZenohBus:
        """Another process of that role, which does what it should not."""
        self._rogues.append(self._open(role))
        return self._rogues[-1]

    def _open(self, role: Role) -> ZenohBus:
        return open_bus(self.endpoint, 5_000, access=read_access(self.folder, role.value))

    def ask(self, role: Role, key: str) -> Reply | None:
        replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
        self.bus(role).ask(key, b"", replies.put, 5_000)
        return replies.get(timeout=DEADLINE_S)

    def ask_until_served(self, role: Role, key: str) -> Reply:
        """A server's declaration may still be on its way."""
        for _ in range(1_000):
            if (reply := self.ask(role, key)) is not None:
                return reply
        raise AssertionError(f"nobody answers {key}")

    def close(self) -> None:
        for bus in (*self._buses.values(), *self._rogues):
            bus.close()


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    found = Network(tmp_path / "access")
    with router_process(found.endpoint, found.folder) as found.router:
        yield found
        found.close()


def resident_mb(pid: int) -> float:
    rows = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(row.split()[1]) / 1024 for row in rows if row.startswith("VmRSS"))


def answering(word: bytes) -> Callable[[Request], None]:
    return lambda request: request.reply(word)


def test_nobody_comes_in_without_a_login_or_with_a_wrong_one(network: Network) -> None:
    for access in (None, Access("teacher", "guessed"), Access("nobody", "guessed")):
        with pytest.raises(BusError, match="lets this program in"):
            open_bus(network.endpoint, 0, access=access)


def test_only_learner_and_aggregator_serve_answers(network: Network) -> None:
    for role in Role:
        if role not in {Role.ROUTER, Role.LEARNER}:
            rogue = network.rogue(role)
            rogue.serve(KEYS.answer(), answering(role.value.encode()))
            rogue.serve("**", answering(role.value.encode()))
    network.bus(Role.LEARNER).serve(KEYS.answer(), answering(b"learner"))
    network.ask_until_served(Role.TEACHER, KEYS.answer("s1", "ann"))
    said = {network.ask(Role.TEACHER, KEYS.answer("s1", f"t{number}")) for number in range(50)}
    assert said == {Reply(b"learner")}
    network.bus(Role.AGGREGATOR).serve(CROWD.answer(), answering(b"aggregator"))
    assert network.ask_until_served(Role.WORKER, CROWD.answer("s1", "w1")) == Reply(b"aggregator")


def test_who_needs_the_journals_rows_has_them_and_nobody_else(network: Network) -> None:
    network.bus(Role.LEARNER).serve(KEYS.learner("rows"), answering(b"rows"))
    network.ask_until_served(Role.MONITOR, KEYS.learner("rows"))
    roles = [role for role in Role if role not in {Role.ROUTER, Role.LEARNER}]
    granted = {role for role in roles if network.ask(role, KEYS.learner("rows")) is not None}
    assert granted == {Role.MONITOR}


def test_a_teacher_cannot_speak_as_the_operator_or_to_every_key_at_once(network: Network) -> None:
    network.bus(Role.LEARNER).serve(KEYS.control(), answering(b"done"))
    network.ask_until_served(Role.TEACHER, KEYS.control("s1", "ann"))
    assert network.ask(Role.OPERATOR, KEYS.control("s1", "operator")) == Reply(b"done")
    assert network.ask(Role.TEACHER, KEYS.control("s1", "operator")) is None
    assert network.ask(Role.OPERATOR, KEYS.control("s1", "ann")) is None


def test_what_the_learner_says_is_heard_and_what_a_teacher_says_is_not(network: Network) -> None:
    heard: queue.SimpleQueue[Received] = queue.SimpleQueue()
    network.bus(Role.MONITOR).subscribe(KEYS.decision(), heard.put)
    network.bus(Role.LEARNER).serve(KEYS.learner("list"), answering(b""))
    network.ask_until_served(Role.MONITOR, KEYS.learner("list"))  # the subscription went the same way before
    key = KEYS.decision("s1")
    for role in Role:
        if role is not Role.ROUTER:
            network.rogue(role).publish(key, role.value.encode())
    assert heard.get(timeout=DEADLINE_S).payload == b"learner"
    network.bus(Role.LEARNER).publish(key, b"last")
    assert heard.get(timeout=DEADLINE_S).payload == b"last"
    assert heard.empty()


def test_presence_is_told_to_the_learner_and_not_to_other_teachers(network: Network) -> None:
    seen: queue.SimpleQueue[Presence] = queue.SimpleQueue()
    spied: queue.SimpleQueue[Presence] = queue.SimpleQueue()
    network.bus(Role.WORKER).watch("**", spied.put)
    network.bus(Role.WORKER).watch(KEYS.presences(), spied.put)
    network.bus(Role.LEARNER).watch(KEYS.presences(), seen.put)
    network.bus(Role.TEACHER).announce(KEYS.present("s1", "ann"))
    assert seen.get(timeout=DEADLINE_S) == Presence(KEYS.present("s1", "ann"), present=True)
    network.ask(Role.WORKER, CROWD.join("s1", "w1"))
    assert spied.empty()


def test_a_curious_teacher_hears_the_decisions_and_nothing_of_the_others(network: Network) -> None:
    heard: queue.SimpleQueue[Received] = queue.SimpleQueue()
    curious, learner = network.rogue(Role.TEACHER), network.bus(Role.LEARNER)
    for key in ("**", "sfid/**", KEYS.answer(), KEYS.join(), KEYS.crowd(), KEYS.decision()):
        curious.subscribe(key, heard.put)
    learner.serve(KEYS.answer(), answering(b"saved"))
    learner.serve(KEYS.join(), answering(b"welcome"))
    network.ask_until_served(Role.TEACHER, KEYS.join("s1", "ann"))
    network.ask_until_served(Role.TEACHER, KEYS.answer("s1", "ann"))
    network.bus(Role.AGGREGATOR).publish(KEYS.crowd("s1", "crowd"), b"who is reliable")
    network.bus(Role.AGGREGATOR).publish(CROWD.decision("s1"), b"of the crowd")
    replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    for key in ("@/router", f"@/{'0' * 16}/router/config"):
        curious.ask(key, b"", replies.put, 2_000)
        assert replies.get(timeout=DEADLINE_S) is None
    learner.publish(KEYS.decision("s1"), b"public")
    # One message, once for each subscription of hers that it fits.
    assert {heard.get(timeout=DEADLINE_S) for _ in range(3)} == {Received(KEYS.decision("s1"), b"public")}
    assert heard.empty()


def test_garbage_on_many_connections_keeps_nobody_out(network: Network) -> None:
    protocol, host, port = split_endpoint(network.endpoint)
    assert protocol == "tcp"
    pid = network.router.pid
    before_mb = resident_mb(pid)
    with ExitStack() as stack:
        for number in range(GARBAGE):
            one = stack.enter_context(socket.create_connection((host, port), 10))
            with suppress(OSError):  # the router may have closed it by now
                one.sendall(random.Random(number).randbytes(200))
        begun = time.monotonic()
        network.bus(Role.LEARNER).serve(KEYS.answer(), answering(b"saved"))
        assert network.ask_until_served(Role.TEACHER, KEYS.answer("s1", "ann")) == Reply(b"saved")
        took_s = time.monotonic() - begun
    assert took_s < 3
    assert resident_mb(pid) - before_mb < 32


def test_logins_are_private_files_and_one_that_others_can_read_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "access"
    done = sfid("router", "--config", "--access", str(folder))
    assert done.code == 0, done.stderr
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert {path.name for path in folder.iterdir()} == {
        "users", *(f"{role.value}.login" for role in Role if role is not Role.ROUTER),
    }  # fmt: skip
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {0o600}
    (folder / "teacher.login").chmod(0o644)
    with pytest.raises(SecretError, match=r"teacher\.login: others can read it: `chmod 600 "):
        read_access(folder, "teacher")


def test_the_printed_configuration_has_the_rules_of_every_role_and_no_password(tmp_path: Path) -> None:
    folder = tmp_path / "access"
    done = sfid("router", "--config", "--access", str(folder), "--deployment", "local")
    config = json.loads(done.stdout)
    assert config["access_control"] == access_control(["local"], tls=False)
    assert config["access_control"]["default_permission"] == "deny"
    assert config["transport"]["auth"]["usrpwd"] == {"dictionary_file": str((folder / "users").resolve())}
    assert config["transport"]["link"]["rx"]["max_message_size"] == 65_536 + 4_096
    for role in Role:
        if role is not Role.ROUTER:
            assert read_access(folder, role.value).password not in done.stdout
            assert read_access(folder, role.value).password not in repr(read_access(folder, role.value))


def test_the_rules_allow_what_the_topology_says_and_nothing_else() -> None:
    control = access_control(["local"], tls=True)
    allowed = {key for rule in control["rules"] for key in rule["key_exprs"] if rule["permission"] == "allow"}
    said = {
        key
        for node in topology(KEYS)
        for verb in ("publishes", "subscribes", "serves", "asks", "announces", "watches")
        for key in getattr(node, verb)
    }
    assert allowed == said
    assert [subject["cert_common_names"] for subject in control["subjects"]] == [
        subject["usernames"] for subject in control["subjects"]
    ]
    serving = {
        rule["id"].split()[0]
        for rule in control["rules"]
        if "declare_queryable" in rule["messages"] and KEYS.answer() in rule["key_exprs"]
    }
    assert serving == {"learner"}


def test_a_router_leaves_word_where_its_logins_are_and_takes_it_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    config = RouterConfig(free_endpoint(), access=tmp_path / "access")
    stop = threading.Event()
    found: list[Path | None] = []

    def ready() -> None:
        found.append(noted_folder(config.listen))
        stop.set()

    run(config, ready, stop)
    assert [*found, noted_folder(config.listen)] == [(tmp_path / "access").resolve(), None]
    note_router(config.listen, tmp_path)
    (note,) = (tmp_path / "state" / "sfid" / "routers").iterdir()
    note.write_text(note.read_text().replace('"pid": ', '"pid": 99999999'))
    assert noted_folder(config.listen) is None


def test_a_service_that_starts_before_its_router_waits_for_its_login(tmp_path: Path) -> None:
    endpoint, folder, log = free_endpoint(), tmp_path / "access", tmp_path / "environment.log"
    command = ("environment", "--connect", endpoint, "--access", str(folder))
    with running(*command, stderr=log) as early:
        with router_process(endpoint, folder):
            wait_for("ready", lambda: "ready" in log.read_text())
        assert early.poll() is None
