"""What passes between machines: encrypted, from both ends proved, and never larger than the router takes."""

import queue
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Event

import pytest
import zenoh

from protocol.keys import Keys
from services.router import RouterConfig, RouterError, free_endpoint, run
from services.runtime.access import CleartextError, access_for, read_access
from services.runtime.bus import BusError, Reply
from services.runtime.endpoint import split_endpoint
from services.runtime.secret import SecretError
from services.runtime.zenoh_bus import ZenohBus, open_bus
from tests.contract.router_process import router_process
from tests.services.cli.command_line import sfid
from tests.services.security.certificates import Authority
from tests.services.security.lesson import raw_session

pytestmark = pytest.mark.real
KEYS = Keys("local")
MB = 1024 * 1024
needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")


def highest_memory_mb(pid: int) -> float:
    """Resident memory at its highest so far."""
    rows = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(row.split()[1]) / 1024 for row in rows if row.startswith("VmHWM"))


def ask(bus: ZenohBus, key: str, attempts: int = 500) -> Reply | None:
    """Ask until there is an answer: a server's declaration may still be on its way."""
    replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    for _ in range(attempts):
        bus.ask(key, b"", replies.put, 2_000)
        if (reply := replies.get(timeout=10.0)) is not None:
            return reply
    return None


def test_a_message_of_200_mb_costs_the_router_at_most_32_mb(tmp_path: Path) -> None:
    endpoint, folder = free_endpoint(), tmp_path / "access"
    with router_process(endpoint, folder) as router:
        learner = open_bus(endpoint, 5_000, access=read_access(folder, "learner"))
        learner.serve(KEYS.answer(), lambda request: request.reply(b"saved"))
        teacher = open_bus(endpoint, 5_000, access=read_access(folder, "teacher"))
        assert ask(teacher, KEYS.answer("s1", "ann")) == Reply(b"saved")
        before_mb = highest_memory_mb(router.pid)
        payload = bytes(200 * MB)
        for role, key in (("learner", KEYS.decision("s1")), ("teacher", KEYS.answer("s1", "ann"))):
            with raw_session(endpoint, folder, role) as session:
                session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
                replies = list(session.get(key, payload=payload, timeout=2.0))
                assert [reply.ok for reply in replies if reply.ok is not None] == []
        assert ask(teacher, KEYS.answer("s1", "ann")) == Reply(b"saved")
        grown_mb = highest_memory_mb(router.pid) - before_mb
        learner.close()
        teacher.close()
    sys.stderr.write(f"the router's memory grew by {grown_mb:.1f} MB\n")
    assert grown_mb < 32


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logins, and certificates of an authority of its own, for router, learner and teacher."""
    folder = tmp_path_factory.mktemp("tls")
    assert sfid("router", "--config", "--access", str(folder)).code == 0
    authority = Authority(folder)
    for name in ("router", "learner", "teacher"):
        authority.sign(folder, name)
    return folder


@pytest.fixture(scope="module")
def encrypted(folder: Path) -> Iterator[str]:
    """The endpoint of a router that speaks TLS."""
    _, _, port = split_endpoint(free_endpoint())
    endpoint = f"tls/127.0.0.1:{port}"
    with router_process(endpoint, folder):
        yield endpoint


def copied(folder: Path, to: Path, **renamed: str) -> Path:
    """Return a copy of the folder, with some files in the place of others."""
    shutil.copytree(folder, to)
    for name, source in renamed.items():
        for ending in ("pem", "key"):
            shutil.copy(folder / f"{source}.{ending}", to / f"{name}.{ending}")
    return to


@needs_openssl
def test_learner_and_teacher_meet_over_tls_in_which_both_ends_are_proved(
    encrypted: str, folder: Path
) -> None:
    learner = open_bus(encrypted, 5_000, access=access_for(encrypted, "learner", folder))
    learner.serve(KEYS.answer(), lambda request: request.reply(b"saved"))
    teacher = open_bus(encrypted, 5_000, access=access_for(encrypted, "teacher", folder))
    try:
        assert ask(teacher, KEYS.answer("s1", "ann")) == Reply(b"saved")
    finally:
        teacher.close()
        learner.close()


@needs_openssl
def test_a_certificate_of_another_authority_is_refused_by_either_end(
    encrypted: str, folder: Path, tmp_path: Path
) -> None:
    foreign = copied(folder, tmp_path / "foreign")
    Authority(foreign).sign(foreign, "teacher")
    # First with the foreign authority's file, and then as one who trusts the router but is not trusted.
    for authority in (foreign / "ca.pem", folder / "ca.pem"):
        if authority.parent != foreign:
            shutil.copy(authority, foreign / "ca.pem")
        with pytest.raises(BusError, match="no router at tls/"):
            open_bus(encrypted, 0, access=access_for(encrypted, "teacher", foreign))


@needs_openssl
def test_a_login_with_the_certificate_of_another_role_may_do_nothing(
    encrypted: str, folder: Path, tmp_path: Path
) -> None:
    mixed = copied(folder, tmp_path / "mixed", learner="teacher")
    thief = open_bus(encrypted, 5_000, access=access_for(encrypted, "learner", mixed))
    thief.serve(KEYS.learner("list"), lambda request: request.reply(b"stolen"))
    thief.serve(KEYS.answer(), lambda request: request.reply(b"stolen"))
    learner = open_bus(encrypted, 5_000, access=access_for(encrypted, "learner", folder))
    learner.serve(KEYS.answer(), lambda request: request.reply(b"saved"))
    teacher = open_bus(encrypted, 5_000, access=access_for(encrypted, "teacher", folder))
    try:
        assert {ask(teacher, KEYS.answer("s1", f"t{number}")) for number in range(20)} == {Reply(b"saved")}
    finally:
        for bus in (teacher, learner, thief):
            bus.close()


@needs_openssl
def test_a_missing_certificate_and_a_key_that_others_can_read_are_named(folder: Path, tmp_path: Path) -> None:
    partly = copied(folder, tmp_path / "partly")
    (partly / "teacher.pem").unlink()
    (partly / "learner.key").chmod(0o644)
    with pytest.raises(SecretError, match=r"teacher\.pem: there is no such file: TLS takes it"):
        access_for("tls/127.0.0.1:1", "teacher", partly)
    with pytest.raises(SecretError, match=r"learner\.key: others can read it"):
        access_for("tls/127.0.0.1:1", "learner", partly)


@pytest.mark.parametrize("endpoint", ["tcp/192.0.2.1:7447", "tcp/lab.example:7447", "tcp/[2001:db8::1]:7447"])
def test_a_client_does_not_speak_in_clear_text_to_another_machine_unless_told_so(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(CleartextError, match="nothing on the way is encrypted: connect to tls/HOST:PORT"):
        access_for(endpoint, "teacher", None)
    done = sfid("session", "list", "--connect", endpoint)
    assert (done.code, done.stderr.count("\n")) == (2, 1)
    assert "set SFID_INSECURE_NETWORK=1" in done.stderr
    monkeypatch.setenv("SFID_INSECURE_NETWORK", "1")
    assert access_for(endpoint, "teacher", None) is None


@pytest.mark.parametrize("listen", ["tls/0.0.0.0:7447", "tls/127.0.0.1:7447"])
def test_a_router_speaks_tls_only_with_its_certificates(listen: str, tmp_path: Path) -> None:
    with pytest.raises(RouterError, match="TLS takes certificates: name their directory with --access"):
        run(RouterConfig(listen), lambda: None, Event())
    with pytest.raises(
        SecretError, match=r"ca\.pem: there is no such file: TLS takes it, SECURITY\.md says how"
    ):
        run(RouterConfig(listen, access=tmp_path), lambda: None, Event())
