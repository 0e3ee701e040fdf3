"""The router service: ready, stopped, and every refusal with its mend."""

import queue
import socket
import threading

import pytest

from services.router import RouterConfig, RouterError, free_endpoint, run
from services.runtime.bus import BusError
from services.runtime.endpoint import reached_at
from services.runtime.zenoh_bus import open_bus
from services.runtime.zenoh_config import client_config, is_loopback, router_config, split_endpoint

DEADLINE_S = 5.0


def never_ready() -> None:
    raise AssertionError("the router must not start")


@pytest.mark.real
def test_a_router_is_ready_before_clients_come_and_frees_its_endpoint_when_stopped() -> None:
    config = RouterConfig(free_endpoint())
    stop = threading.Event()
    ready: queue.SimpleQueue[bool] = queue.SimpleQueue()
    for _ in range(2):
        stop.clear()
        thread = threading.Thread(target=run, args=(config, lambda: ready.put(item=True), stop))
        thread.start()
        try:
            assert ready.get(timeout=DEADLINE_S)
            bus = open_bus(config.listen, timeout_ms=0)
            assert bus.connected()
            bus.close()
        finally:
            stop.set()
            thread.join(DEADLINE_S)
        assert not thread.is_alive()


@pytest.mark.real
def test_a_taken_endpoint_is_named_with_its_mend() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        listen = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(RouterError) as caught:
            run(RouterConfig(listen), never_ready, threading.Event())
    assert str(caught.value) == (
        f"cannot listen at {listen}: another program has it, stop that one or pass another --listen"
    )


@pytest.mark.parametrize(
    "listen", ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/192.0.2.1:7447", "tcp/lab.example:7447"]
)
def test_an_endpoint_open_to_the_network_is_refused_and_the_flag_is_named(listen: str) -> None:
    with pytest.raises(RouterError) as caught:
        run(RouterConfig(listen), never_ready, threading.Event())
    assert str(caught.value) == (
        f"{listen} can be reached from other machines and nothing there is encrypted: listen at "
        "tcp/127.0.0.1:7447 or at tls/HOST:PORT (SECURITY.md), or, trusting everybody there, run "
        "`sfid router --insecure-bind`"
    )


@pytest.mark.real
def test_the_flag_lets_it_listen_to_the_network() -> None:
    stop = threading.Event()
    stop.set()
    ready: queue.SimpleQueue[bool] = queue.SimpleQueue()
    _, _, port = split_endpoint(free_endpoint())
    run(RouterConfig(f"tcp/0.0.0.0:{port}", insecure_bind=True), lambda: ready.put(item=True), stop)
    assert ready.get_nowait()


@pytest.mark.parametrize(
    "listen,there",
    [
        ("tls/0.0.0.0:7447", "tls/127.0.0.1:7447"),
        ("tcp/[::]:7447", "tcp/[::1]:7447"),
        ("tcp/192.0.2.1:7447", "tcp/192.0.2.1:7447"),
    ],
)
def test_a_router_at_all_addresses_is_reached_at_the_loopback(listen: str, there: str) -> None:
    assert reached_at(listen) == there


def test_a_malformed_endpoint_is_refused_with_an_example() -> None:
    with pytest.raises(
        RouterError, match=r"'7447' is not of the form tcp/HOST:PORT, as in tcp/127\.0\.0\.1:7447"
    ):
        run(RouterConfig("7447"), never_ready, threading.Event())


@pytest.mark.parametrize(
    "host",
    ["a b", "127.0.0.1/x", "h?x=1", "[::1", "::1", "[127.0.0.1]", "999.1.1.1", "1.2.3", "a..b", "-a", "a-",
     "[]", "x" * 64, ".", "a#b", "a\n", "ä.example", "7"],
)  # fmt: skip
def test_what_can_be_no_host_is_refused_in_one_line(host: str) -> None:
    with pytest.raises(BusError) as caught:
        split_endpoint(f"tcp/{host}:7447")
    assert str(caught.value) == (
        f"endpoint {f'tcp/{host}:7447'!r}: {host!r} is no host: "
        "give a name, an IPv4 address, or an IPv6 address as in [::1]"
    )
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("host", ["lab.example", "lab.example.", "sfid_router-1", "192.0.2.7", "[::1]"])
def test_a_name_and_an_address_are_hosts(host: str) -> None:
    assert split_endpoint(f"tls/{host}:1") == ("tls", host.strip("[]"), 1)


@pytest.mark.parametrize("port", ["0", "00", "65536", "99999", "1" * 5_000, "-1", "", "٣"])
def test_what_can_be_no_port_is_refused(port: str) -> None:
    with pytest.raises(BusError, match="is not of the form tcp/HOST:PORT"):
        split_endpoint(f"tcp/localhost:{port}")


@pytest.mark.parametrize("host", ["127.0.0.1", "127.9.9.9", "[::1]", "localhost"])
def test_these_hosts_are_reached_by_this_machine_only(host: str) -> None:
    assert is_loopback(f"tcp/{host}:1")


@pytest.mark.parametrize("host", ["192.168.0.1", "[::]", "10.0.0.1", "localhost.lab"])
def test_these_hosts_may_be_reached_by_others(host: str) -> None:
    assert not is_loopback(f"tls/{host}:1")


def test_neither_clients_nor_the_router_find_others_by_themselves_or_share_memory() -> None:
    for config in (client_config("tcp/127.0.0.1:1"), router_config("tcp/127.0.0.1:1")):
        assert config["scouting"] == {
            "multicast": {"enabled": False},
            "gossip": {"enabled": False},
            "delay": 0,
        }
        assert config["transport"]["shared_memory"] == {"enabled": False}
    assert client_config("tcp/127.0.0.1:1")["connect"]["endpoints"] == ["tcp/127.0.0.1:1"]
    assert "listen" not in client_config("tcp/127.0.0.1:1")
    assert router_config("tcp/127.0.0.1:1")["listen"]["endpoints"] == ["tcp/127.0.0.1:1"]
