"""`sfid gateway` and `sfid invite` as a person at a terminal uses them (ring 3)."""

import http.client
import json
import shutil
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from protocol.identity import Role, TokenError, verify
from services.cli.shared import launch
from services.gateway.service import read_status
from services.router import free_endpoint
from services.runtime.config import GatewaySection
from services.runtime.register import Register
from services.runtime.secret import load_secrets
from services.runtime.signals import Stop

pytestmark = pytest.mark.real


def sfid(*arguments: str) -> tuple[int, str, str]:
    command = [sys.executable, "-P", "-m", "services.cli.main", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stdout, done.stderr


def read(*arguments: str) -> dict[str, Any]:
    code, out, error = sfid(*arguments, "--json")
    assert code == 0, error
    return dict(json.loads(out))


def router_of(data: Path) -> str:
    return (data / "logs" / "router.log").read_text().split("ready: ")[1].split()[0]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The data directory of a running gateway."""
    data = tmp_path_factory.mktemp("gateway")
    deployed = launch.Deployed(data, free_endpoint(), "local")
    supervisor = launch.supervise(data, launch.make_directories(data), Stop())
    try:
        supervisor.start(launch.router(deployed))
        supervisor.start(launch.gateway(deployed, GatewaySection(enabled=True, listen="127.0.0.1:0")))
        yield data
    finally:
        supervisor.stop()


def test_an_invitation_is_a_link_with_its_token_in_the_fragment(data: Path) -> None:
    made = read("invite", "--session", "s1", "--people", "12", "--hours", "2", "--data", str(data))
    address, _, token = made.pop("url").partition("/#t=")
    identity = verify(token, load_secrets(data / "gateway"), time.time(), ())
    assert address == read_status(data)["url"]
    assert (identity.role, identity.session, identity.people) == (Role.INVITATION, "s1", 12)
    assert made == {
        "id": identity.token_id, "session": "s1", "name": None, "people": 12, "expires_s": identity.expires_s,
    }  # fmt: skip
    assert 7190 < identity.expires_s - time.time() <= 7200


def test_a_link_for_one_person_carries_their_name_and_can_be_withdrawn(data: Path) -> None:
    made = read("invite", "--session", "s1", "--name", "ann", "--data", str(data))
    token, secrets = made["url"].partition("/#t=")[2], load_secrets(data / "gateway")
    assert verify(token, secrets, time.time(), ()).pseudonym == "ann"
    assert read("invite", "--revoke", made["id"], "--data", str(data)) == {"revoked": made["id"]}
    with pytest.raises(TokenError, match="revoked"):
        verify(token, secrets, time.time(), Register(data / "gateway").revoked)


def test_a_person_is_shown_a_code_to_scan_and_how_to_withdraw_it(data: Path) -> None:
    code, out, err = sfid("invite", "--session", "s1", "--data", str(data))
    lines = out.splitlines()
    assert code == 0
    assert err.splitlines()[-1].startswith(f"cannot see the learner's sessions in {data}, so ")
    assert sum("█" in line for line in lines) > 15
    assert lines[-3].startswith(f"{read_status(data)['url']}/#t=")
    assert lines[-1].startswith("withdraw it: `sfid invite --revoke ")
    assert lines[-1].endswith(f" --data {data}`")


def test_the_status_says_where_the_page_is_and_what_was_refused(data: Path) -> None:
    url = read_status(data)["url"]
    connection = http.client.HTTPConnection(url.partition("://")[2])
    connection.request("GET", "/nothing")
    assert connection.getresponse().status == 404
    until = time.monotonic() + 10
    while not (found := read("gateway", "--status", "--data", str(data)))["refused"]:
        assert time.monotonic() < until
    assert (found["url"], found["people"], found["refused"]) == (url, 0, {"path": 1})
    code, out, _ = sfid("gateway", "--status", "--data", str(data))
    assert code == 0
    assert out.splitlines()[0].startswith(url)
    assert out.splitlines()[-1] == "refused: path 1"


def test_the_gateway_says_in_one_line_that_its_port_is_taken(data: Path) -> None:
    taken = read_status(data)["url"].partition("://")[2]
    processes = json.loads((data / "processes.json").read_text())
    assert {one["role"] for one in processes} == {"router", "gateway"}
    code, _, error = sfid("gateway", "--connect", router_of(data), "--data", str(data), "--listen", taken)
    assert code == 2
    last = error.splitlines()[-1]
    assert last.startswith(f"sfid: cannot listen at {taken}: ")
    assert last.endswith("stop the other program or pass another --listen")


@pytest.mark.parametrize(
    "arguments, code, reason",
    [
        (["gateway", "--listen", "0.0.0.0:80"], 2, "nothing would be encrypted"),
        (["gateway", "--listen", "here"], 2, "is no address"),
        (["gateway", "--status"], 1, "no gateway has run here"),
        (
            ["invite", "--session", "s1"],
            1,
            "no gateway has run here: start one with `sfid up --gateway --data ",
        ),
        (["invite", "--session", "s1", "--name", "ann", "--people", "3"], 2, "a name is one person's"),
        (["invite"], 2, "name the one to teach"),
        (["invite", "--session", "S 1"], 2, "is not allowed"),
        (["invite", "--session", "s1", "--people", "0"], 2, "give 1 to 100000"),
        (["invite", "--session", "s1", "--hours", "0"], 2, "more than 0"),
        (["invite", "--revoke", "nonsense"], 2, "is no id"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    tmp_path: Path, arguments: list[str], code: int, reason: str
) -> None:
    found, out, error = sfid(*arguments, "--data", str(tmp_path))
    assert (found, out) == (code, "")
    assert reason in error
    assert len(error.splitlines()) == 1


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl to make a certificate with")
def test_with_a_certificate_the_page_is_served_encrypted_and_says_so(tmp_path: Path, data: Path) -> None:
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    request = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:prime256v1",
        "-nodes",
    ]
    request += ["-days", "1", "-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1"]
    request += ["-out", str(certificate), "-keyout", str(key)]
    subprocess.run(request, check=True, capture_output=True)
    deployed = launch.Deployed(tmp_path, router_of(data), "local", access=data / "access")
    supervisor = launch.supervise(tmp_path, launch.make_directories(tmp_path), Stop())
    section = GatewaySection(enabled=True, listen="127.0.0.1:0", tls_cert=str(certificate), tls_key=str(key))
    try:
        supervisor.start(launch.gateway(deployed, section))
        url = read_status(tmp_path)["url"]
        context = ssl.create_default_context(cafile=str(certificate))
        connection = http.client.HTTPSConnection(url.partition("://")[2], context=context)
        connection.request("GET", "/")
        response = connection.getresponse()
        assert (url[:8], response.status) == ("https://", 200)
        assert response.headers["Strict-Transport-Security"] == "max-age=31536000"
        assert f" wss://{url[8:]}/socket;" in response.headers["Content-Security-Policy"]
    finally:
        supervisor.stop()
