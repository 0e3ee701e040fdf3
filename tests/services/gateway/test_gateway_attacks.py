"""Strangers, liars and flooders at the gateway: refused with a counted reason, honest people unaffected."""

import contextlib
import json
import logging
import random
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from protocol.identity import Identity, Role, sign
from tests.services.gateway.gateway_house import Browser, Gateway, gateway

pytestmark = pytest.mark.real

ORIGINS = {
    "another site": "https://evil.example",
    "null": "null",
    "missing": None,
    "another port": "http://127.0.0.1:1",
    "another scheme": "https://{host}",
    "a sub-domain": "http://teach.{host}",
    "capital letters": "HTTP://{host}",
    "a trailing dot": "http://{name}.:{port}",
}
MALFORMED = (
    "", "nonsense", "{}", "[]", "null", "7", '{"type":"answer"}', '{"type":"ping","more":1}',
    '{"type":"nothing"}', '{"type":"ping"', '{"type":7}', '{"type":"answer","id":"x"}', "[" * 2000,
    '{"a":' * 500, '{"type":"pi\\ud800ng"}', '{"type":"submit","screen":"Teach","button":"go"}',
    '{"type":"submit","screen":"../x","button":"go"}',
)  # fmt: skip


@pytest.fixture
def house(tmp_path: Path) -> Iterator[Gateway]:
    with gateway(tmp_path) as running:
        yield running


def is_served(browser: Browser, number: int = 1) -> bool:
    """Whether an honest person's answer is taken and acknowledged."""
    decision = next(frame for frame in browser.frames if frame["type"] == "decision")
    browser.answer(number, decision)
    return bool(browser.next("answer", id=f"{number:032x}")["state"] == "saved")


def status_of(house: Gateway, *lines: str) -> int:
    """Return the status of the response to a request written by hand."""
    with socket.create_connection(("127.0.0.1", int(house.host.partition(":")[2])), 5) as raw:
        raw.sendall("\r\n".join((*lines, "", "")).encode())
        return int(raw.makefile("rb").readline().split()[1])


def deaf_browser(house: Gateway) -> socket.socket:
    """Return the socket of somebody who has said hello and reads nothing."""
    raw = socket.socket()
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    raw.connect(("127.0.0.1", int(house.host.partition(":")[2])))
    lines = (
        "GET /socket HTTP/1.1", f"Host: {house.host}", f"Origin: {house.url}", "Upgrade: websocket",
        "Connection: Upgrade", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: " + "A" * 22 + "==", "", "",
    )  # fmt: skip
    raw.sendall("\r\n".join(lines).encode())
    hello = {"type": "hello", "version": 1, "token": house.token("eve"), "nonce": "0" * 32}
    text = json.dumps(hello).encode()
    raw.sendall(b"\x81" + bytes([0x80 | 126]) + len(text).to_bytes(2, "big") + bytes(4) + text)
    return raw


@pytest.mark.parametrize("variant", ORIGINS)
def test_a_page_of_another_origin_opens_no_socket(house: Gateway, variant: str) -> None:
    name, _, port = house.host.partition(":")
    origin = ORIGINS[variant]
    told = None if origin is None else origin.format(host=house.host, name=name, port=port)
    with pytest.raises(InvalidStatus) as refused:
        house.browser(origin=told)
    assert refused.value.response.status_code == 403
    house.refused(origin=1)
    assert is_served(house.teacher()[0])


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1:1", "localhost", ""])
def test_a_name_that_was_pointed_at_us_is_not_served(house: Gateway, host: str) -> None:
    assert status_of(house, "GET / HTTP/1.1", f"Host: {host}") == 421
    house.refused(host=1)


def test_nothing_but_the_page_is_served_and_always_with_its_policy(house: Gateway) -> None:
    for path in ("/secret", "/../secret", "/%2e%2e/config.py", "//index.html", "/page/", "/status.json"):
        assert status_of(house, f"GET {path} HTTP/1.1", f"Host: {house.host}") == 404
    house.refused(path=6)
    with socket.create_connection(("127.0.0.1", int(house.host.partition(":")[2])), 5) as raw:
        raw.sendall(f"GET /?PROLIFIC_PID=1 HTTP/1.1\r\nHost: {house.host}\r\n\r\n".encode())
        head = raw.makefile("rb").read().partition(b"\r\n\r\n")[0].decode().lower().split("\r\n")
    headers = dict(line.split(": ", 1) for line in head[1:])
    assert head[0] == "http/1.1 200 ok"
    policy = headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self'; ")
    assert "; img-src 'self' data:; " in policy
    assert "unsafe" not in policy
    assert f"connect-src 'self' ws://{house.host}/socket;" in policy
    assert {name: headers[name] for name in (
        "x-content-type-options", "referrer-policy", "cross-origin-opener-policy", "cache-control",
    )} == {
        "x-content-type-options": "nosniff", "referrer-policy": "no-referrer",
        "cross-origin-opener-policy": "same-origin", "cache-control": "no-store",
    }  # fmt: skip
    assert "server" not in headers


def test_the_page_holds_no_inline_script_or_style_and_nothing_from_elsewhere() -> None:
    folder = Path(__file__).parents[3] / "services" / "gateway" / "page"
    for path in folder.iterdir():
        text = path.read_text()
        assert "innerHTML" not in text
        assert "eval(" not in text
        assert "style=" not in text
        addresses = {word for word in text.replace('"', " ").replace("'", " ").split() if "://" in word}
        assert all(
            "www.w3.org" in word or word in {"https://", "`${location.protocol"} or "${" in word
            for word in addresses
        )
    assert "<script>" not in (folder / "index.html").read_text()


def test_of_tokens_forged_expired_revoked_or_altered_none_is_let_in(house: Gateway) -> None:
    honest, _ = house.teacher("ann")
    chance = random.Random(5)
    token = house.token("bea", token_id="d" * 16)
    house.revoke("d" * 16)
    stranger = Identity(
        role=Role.TEACHER, session="s1", pseudonym="eve", expires_s=house.expires_s, token_id="e" * 16
    )
    attempts = {
        "forged-token": [sign(stranger, [chance.randbytes(32)]) for _ in range(40)],
        "expired-token": [house.token("eve", expires_s=int(time.time()) - second) for second in range(1, 20)],
        "revoked-token": [token] * 20,
        "malformed-token": ["", "x", "a.b.c", "\x00", "{}"] * 4,
    }
    good = house.token("eve")
    attempts["forged-token"] += [
        good[:place] + ("A" if good[place] != "A" else "B") + good[place + 1 :]
        for place in range(len(good))
        if good[place] != "."
    ]
    for reason, tokens in attempts.items():
        for bad in tokens:
            browser = house.browser().hello(bad)
            assert browser.next("refused")["reason"] == reason
            assert browser.closed() == 4401
    house.refused(**{reason.replace("-", "_"): len(tokens) for reason, tokens in attempts.items()})
    assert is_served(honest)
    assert {join.teacher for join in house.learner.joins} == {"ann"}


def test_nobody_speaks_for_another_or_into_another_session(house: Gateway) -> None:
    ann, decision = house.teacher("ann")
    eve, _ = house.teacher("eve")
    spoofs = [{"teacher": "ann"}, {"token": house.token("ann")}, {"name": "ann"}]
    for number, spoof in enumerate(spoofs):
        eve.answer(number, decision, **spoof)
        assert eve.next("refused")["reason"] == "malformed"
    eve.answer(9, decision, session="s2")
    assert eve.next("answer")["reason"] == "you do not teach this session"
    eve.hello(house.token("ann"))
    assert eve.next("refused")["text"] == "hello is said once"
    eve.answer(10, decision)
    assert eve.next("answer")["state"] == "saved"
    assert [answer.teacher for answer in house.learner.answers] == ["eve"]
    house.refused(frame_malformed=4, not_teaching=1)
    assert is_served(ann, 11)


def test_a_replayed_answer_gets_its_old_acknowledgement_and_reaches_nobody(house: Gateway) -> None:
    ann, decision = house.teacher("ann")
    ann.answer(1, decision)
    told = ann.next("answer")
    for _ in range(20):
        ann.answer(1, decision)
        assert ann.next("answer") == told
    assert len(house.learner.payloads) == 1
    house.refused(replay=20)
    other_body = ann.answer(1, decision, action="DOWN")
    ann.next("answer", id=other_body)
    assert len(house.learner.payloads) == 2  # the learner says that this is a conflict


def test_a_flood_at_ten_times_the_rate_is_cut_off_and_honest_people_notice_nothing(house: Gateway) -> None:
    honest = [house.teacher(f"p{number}") for number in range(5)]
    eve, decision = house.teacher("eve")
    waits = []
    number = 0
    try:
        for turn in range(80):
            for _ in range(10):
                number += 1
                eve.answer(number, decision)
            for person, seen in honest if turn % 4 == 0 else ():
                number += 1
                began = time.perf_counter()
                person.answer(number, seen)
                assert person.next("answer", id=f"{number:032x}")["state"] == "saved"
                waits.append(time.perf_counter() - began)
    except ConnectionClosed:
        pass
    # Cut off after a hundred refusals, while the honest went on being served.
    assert eve.closed() == 4429
    assert sorted(waits)[int(len(waits) * 0.9)] < 0.25
    for person, seen in honest:
        number += 1
        person.answer(number, seen)
        assert person.next("answer", id=f"{number:032x}")["state"] == "saved"
    refused = house.status(lambda found: found["refused"].get("flooder-closed") == 1)["refused"]
    assert refused["flood"] >= 100
    of_eve = [answer for answer in house.learner.answers if answer.teacher == "eve"]
    assert len(of_eve) < 150


@pytest.mark.parametrize("size", [4097, 65_536, 5_000_000])
def test_a_giant_frame_ends_its_connection_and_no_other(house: Gateway, size: int) -> None:
    honest, _ = house.teacher("ann")
    eve, _ = house.teacher("eve")
    eve.socket.send('{"type":"ping"' + " " * size + "}")
    assert eve.closed() == 1009
    house.refused(frame_too_large=1)
    assert is_served(honest)


def test_malformed_frames_are_counted_and_end_the_connection_at_the_tenth(house: Gateway) -> None:
    honest, _ = house.teacher("ann")
    for number, frame in enumerate(MALFORMED):
        eve, _ = house.teacher(f"eve{number}")
        for _ in range(9):
            eve.socket.send(frame)
            assert eve.next("refused")["reason"] == "malformed"
        assert is_served(eve, number)
        eve.socket.send(frame)
        assert eve.closed() == 4400
    house.refused(frame_malformed=10 * len(MALFORMED))
    assert is_served(honest, 1000)


def test_binary_frames_are_not_read(house: Gateway) -> None:
    eve, _ = house.teacher("eve")
    for _ in range(10):
        eve.socket.send(b"\x00\x01")
    assert eve.closed() == 4400
    house.refused(frame_binary=10)


@pytest.mark.parametrize(
    "first", ['{"type":"ping"}', "x", '{"type":"hello","version":2,"token":"","nonce":""}']
)
def test_one_who_does_not_say_hello_first_is_let_go(house: Gateway, first: str) -> None:
    eve = house.browser()
    eve.socket.send(first)
    assert eve.closed() == 4400
    house.refused(frame_malformed=1)


def test_one_who_says_nothing_is_let_go(tmp_path: Path) -> None:
    with gateway(tmp_path, hello_timeout_s=0.2) as house:
        assert house.browser().closed() == 4400
        house.refused(hello_timeout=1)


def test_connections_beyond_the_limit_are_ended_at_once(tmp_path: Path) -> None:
    with gateway(tmp_path, connections_per_address_max=4, open_timeout_s=0.5) as house:
        honest, _ = house.teacher("ann")
        port = int(house.host.partition(":")[2])
        silent = [socket.create_connection(("127.0.0.1", port), 5) for _ in range(40)]
        house.status(lambda found: found["refused"].get("connections", 0) >= 37)
        assert is_served(honest)
        for one in silent:  # those that were let in never asked for anything, and are let go in time
            one.settimeout(5)
            with contextlib.suppress(ConnectionResetError):
                assert one.recv(1) == b""
            one.close()
        assert is_served(house.teacher("bea")[0], 2)


def test_garbage_instead_of_a_request_disturbs_nobody(house: Gateway) -> None:
    honest, _ = house.teacher("ann")
    chance = random.Random(6)
    port = int(house.host.partition(":")[2])
    for _ in range(50):
        with socket.create_connection(("127.0.0.1", port), 5) as raw:
            raw.sendall(chance.randbytes(300) + b"\r\n\r\n")
    assert is_served(honest)


def test_a_browser_that_does_not_read_is_let_go(tmp_path: Path) -> None:
    with gateway(tmp_path, buffered_bytes_max=20_000) as house:
        honest, _ = house.teacher("ann")
        with deaf_browser(house):
            house.status(lambda found: found["people"] == 2)
            view = "\n".join(["#" * 180] * 180)
            for number in range(2, 60):
                house.learner.go_on(decision=number, view=view)
                honest.next("decision", decision=number)
            house.status(lambda found: found["refused"].get("slow-reader") == 1)
        assert is_served(honest)


def test_a_page_that_was_left_open_is_let_go(tmp_path: Path) -> None:
    with gateway(tmp_path, idle_timeout_s=0.5) as house:
        ann, _ = house.teacher("ann")
        ann.send("ping")
        assert ann.next("refused")["reason"] == "idle"
        assert ann.closed() == 4408
        house.refused(idle=1)


def test_a_person_cannot_connect_over_and_over(tmp_path: Path) -> None:
    with gateway(tmp_path, hellos_per_minute=9.0) as house:
        token = house.token("eve")
        for _ in range(3):
            house.browser().hello(token).next("you")
        assert house.browser().hello(token).next("refused")["reason"] == "hello-rate"
        house.refused(hello_rate=1)


def test_no_token_is_ever_logged(house: Gateway, caplog: pytest.LogCaptureFixture) -> None:
    for name in (None, "sfid", "sfid.gateway"):
        logging.getLogger(name).setLevel(logging.DEBUG)
    caplog.handler.setLevel(logging.DEBUG)
    own, invitation, forged = house.token("ann"), house.invitation(5), "forged" + house.token("eve")
    with caplog.at_level(logging.DEBUG):
        for token in (own, invitation, forged):
            browser = house.browser(logger=logging.getLogger("silent.client")).hello(token)
            browser.next("refused" if token == forged else "you")
        house.status(lambda found: bool(found["refused"]))
    logging.getLogger(None).setLevel(logging.WARNING)
    mine = [record.getMessage() for record in caplog.records if record.name != "silent.client"]
    text = "\n".join(mine) + json.dumps(house.status(lambda _: True))
    for token in (own, invitation, forged):
        assert token not in text
        assert token.rpartition(".")[2] not in text
