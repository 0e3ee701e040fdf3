"""What a command waits for, what it does not wait for, and what it says meanwhile."""

import logging
import threading
import time
from pathlib import Path

import pytest

from services.cli.session_hint import session_hint
from services.cli.shared.options import SERVICE_CONNECT_TIMEOUT_MS
from services.cli.shared.waiting import Told, service_bus
from services.router import RouterConfig
from services.runtime.access import CertificateError, make_access
from services.runtime.bus import BusError
from services.runtime.secret import SecretError
from services.topology import Role
from tests.services.linked import certified, routing, tls_endpoint


@pytest.mark.parametrize("login", ["there", "not there yet"])
def test_a_missing_certificate_is_told_at_once_and_not_waited_for(login: str, tmp_path: Path) -> None:
    if login == "there":
        make_access(tmp_path, ["teacher"])
    (tmp_path / "ca.pem").touch()
    begun = time.monotonic()
    with pytest.raises(CertificateError, match=r"teacher\.pem: there is no such file"):
        service_bus(tls_endpoint(), threading.Event(), Role.TEACHER, tmp_path)
    assert time.monotonic() - begun < SERVICE_CONNECT_TIMEOUT_MS / 1000 / 3


def test_what_is_waited_for_is_said_once_of_router_and_login_and_not_before_two_seconds(
    caplog: pytest.LogCaptureFixture,
) -> None:
    told = Told("tcp/127.0.0.1:7447", 100.0)
    with caplog.at_level(logging.INFO, logger="sfid.waiting"):
        told.note(SecretError("no login"), 101.9)
        assert caplog.messages == []
        for now_s in (102.0, 103.0):
            told.note(SecretError("no login"), now_s)
            told.note(BusError("no router"), now_s)
    assert caplog.messages == [
        "waiting up to 30 s for the login for the router at tcp/127.0.0.1:7447: no login",
        "waiting up to 30 s for the router at tcp/127.0.0.1:7447: no router",
    ]


def test_a_teacher_of_a_router_that_is_gone_is_told_so_whatever_logins_are_there(tmp_path: Path) -> None:
    at = tls_endpoint()
    assert session_hint("maze", at, "local", tmp_path) == f"the router {at} does not answer: waiting for it"


def test_a_teacher_without_an_operators_login_is_told_who_can_look(tmp_path: Path) -> None:
    at, town = tls_endpoint(), certified(tmp_path / "town", "router", "teacher")
    with routing(RouterConfig(at, access=town)):
        said = session_hint("maze", at, "local", town)
    assert said == (
        f"waiting for it: who created it sees in `sfid session list --connect {at}` whether it is there"
    )
