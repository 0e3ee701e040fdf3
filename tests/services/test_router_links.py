"""Routers linked with one another: in any order, again and again, and never in clear text by mistake."""

import queue
import threading
import time
from pathlib import Path

import pytest

from protocol.keys import Keys, router_key
from services.router import RouterConfig, RouterError, free_endpoint, run
from services.router_links import EDGE_ROLES, Link, LinkWatch, allow_links
from services.runtime.bus import Presence, Received, Reply, Request
from services.runtime.secret import SecretError
from services.runtime.zenoh_bus import ZenohRouter, open_bus
from services.topology import access_control, topology
from tests.contract.router_process import router_process
from tests.services.cli.command_line import wait_for
from tests.services.faults_network.weather import Proxy
from tests.services.linked import DEADLINE_S, ask, ask_until_served, routing

KEYS, CROWD = Keys("local"), Keys("local-crowd")
CUTS = 6
"""At least one of so many meets the moment in which Zenoh alone forgets what the other declared."""
FORGOTTEN_S = 1.5
"""A link that was cut and only that is back in 0.6 s."""


@pytest.mark.real
@pytest.mark.parametrize("late", ["the one that connects", "the one that is connected to"])
def test_two_routers_are_linked_whichever_starts_first_and_again_when_either_comes_back(late: str) -> None:
    inner, outer = free_endpoint(), free_endpoint()
    order: list[tuple[str, tuple[str, ...]]] = [(outer, (inner,)), (inner, ())]
    if late == "the one that connects":
        order.reverse()
    (first, its_links), (second, other_links) = order
    with router_process(first, connect=its_links):
        stays = open_bus(first, 5_000)
        stays.serve(KEYS.answer("s1"), lambda request: request.reply(b"saved"))
        for _ in range(2):
            with router_process(second, connect=other_links):
                goes = open_bus(second, 5_000)
                assert ask_until_served(goes, KEYS.answer("s1", "ann")) == Reply(b"saved")
                goes.close()
        stays.close()


@pytest.mark.real
@pytest.mark.timeout(60)
def test_a_link_that_breaks_as_soon_as_it_came_carries_again_within_ten_seconds() -> None:
    inner, outer = free_endpoint(), free_endpoint()
    with (
        router_process(inner),
        Proxy(int(inner.rpartition(":")[2]), 9) as link,
        router_process(outer, connect=[link.endpoint]),
    ):
        learner, teacher = open_bus(inner, 5_000), open_bus(outer, 5_000)
        learner.serve(KEYS.answer("s1"), lambda request: request.reply(b"saved"))
        for _ in range(CUTS):
            begun = time.monotonic()
            assert ask_until_served(teacher, KEYS.answer("s1", "ann")) == Reply(b"saved")
            if time.monotonic() - begun > FORGOTTEN_S:
                break
            link.cut()
        assert ask_until_served(teacher, KEYS.answer("s1", "ann")) == Reply(b"saved")
        teacher.close()
        learner.close()


@pytest.mark.real
def test_over_three_routers_in_a_circle_everything_arrives_once() -> None:
    ends = [free_endpoint() for _ in range(3)]
    heard: queue.SimpleQueue[Received] = queue.SimpleQueue()
    seen: queue.SimpleQueue[Presence] = queue.SimpleQueue()
    configs = [
        RouterConfig(end, connect=(*ends[:number], *ends[number + 1 :])) for number, end in enumerate(ends)
    ]
    with routing(configs[0]), routing(configs[1]), routing(configs[2]):
        learner, ann, bob = (open_bus(end, int(DEADLINE_S * 1000)) for end in ends)
        asked: list[str] = []

        def welcome(request: Request) -> None:
            asked.append(request.key)
            request.reply(b"welcome")

        learner.serve(KEYS.join(), welcome)
        learner.watch(KEYS.presences(), seen.put)
        for name, teacher in (("ann", ann), ("bob", bob)):
            teacher.subscribe(KEYS.decision(), heard.put)
            assert ask_until_served(teacher, KEYS.join("s1", name)) == Reply(b"welcome")
        for number in range(200):
            learner.publish(KEYS.decision("s1"), str(number).encode())
        told = [heard.get(timeout=DEADLINE_S).payload for _ in range(400)]
        assert sorted(told, key=int) == [str(number // 2).encode() for number in range(400)]
        ann.announce(KEYS.present("s1", "ann"))
        bob.announce(KEYS.present("s1", "bob"))
        there = {seen.get(timeout=DEADLINE_S).key for _ in range(2)}
        assert there == {KEYS.present("s1", "ann"), KEYS.present("s1", "bob")}
        bob.close()
        assert seen.get(timeout=DEADLINE_S) == Presence(KEYS.present("s1", "bob"), present=False)
        assert asked == [KEYS.join("s1", "ann"), KEYS.join("s1", "bob")]
        assert ask(ann, KEYS.join("s1", "ann")) == Reply(b"welcome")
        assert (heard.empty(), seen.empty()) == (True, True)
        learner.close()
        ann.close()


def test_a_link_over_which_nothing_is_found_is_made_anew_at_the_third_look_and_then_ever_later() -> None:
    watch = LinkWatch()
    anew = [look for look in range(1, 80) if watch.wants_anew({"a": True, "b": False})]
    assert anew == [3, 4 * 3, 16 * 3]
    # Whoever was found in between is made anew at the third look again.
    assert not watch.wants_anew({"b": True})
    assert [watch.wants_anew({"b": False}) for _ in range(3)] == [False, False, True]
    # One that is gone, or comes and goes, was not missed.
    other = LinkWatch()
    assert not any(
        other.wants_anew(each) for each in ({"c": False}, {"c": False}, {}, {"c": False}, {"c": True})
    )


@pytest.mark.real
def test_a_router_watches_those_it_connected_to_and_not_who_connects_to_it() -> None:
    ends = [free_endpoint() for _ in range(3)]
    below = ZenohRouter(ends[0], "it listens")
    middle = ZenohRouter(ends[1], "it listens", connect=(ends[0],))
    above = ZenohRouter(ends[2], "it listens", connect=(ends[1],))
    try:
        wait_for("all are linked and found", lambda: [*above.neighbours(500).values()] == [True], DEADLINE_S)
        wait_for("so is the first", lambda: [*middle.neighbours(500).values()] == [True], DEADLINE_S)
        assert len({*middle.neighbours(500), *above.neighbours(500)}) == 2
        assert below.neighbours(500) == {}
    finally:
        for router in (above, middle, below):
            router.close()


@pytest.mark.parametrize(
    "config,message",
    [
        (
            RouterConfig(connect=("tcp/192.0.2.1:7447",)),
            (
                "tcp/192.0.2.1:7447 is on another machine and nothing on the way is encrypted: connect to "
                "tls/HOST:PORT (MACHINES.md), or, trusting everybody there, run `sfid router --insecure-bind`"
            ),
        ),
        (
            RouterConfig(connect=("tls/192.0.2.1:7447",)),
            "tls/192.0.2.1:7447: TLS takes certificates: name their directory with --access",
        ),
        (
            RouterConfig(connect=("tcp/127.0.0.1:7448",), access=Path("access")),
            (
                "tcp/127.0.0.1:7448: a router that asks for logins knows another by its certificate: connect "
                "to tls/HOST:PORT (MACHINES.md), or let both ask nobody, with `sfid router --open-to-all`"
            ),
        ),
        (
            RouterConfig(connect=("tcp/127.0.0.1:7447",)),
            "tcp/127.0.0.1:7447: a router cannot be linked with itself: name another one with --connect",
        ),
        (
            RouterConfig(connect=("192.0.2.1",)),
            "endpoint '192.0.2.1' is not of the form tcp/HOST:PORT, as in tcp/127.0.0.1:7447",
        ),
    ],
)
def test_a_link_that_cannot_or_should_not_be_is_refused_in_one_line_with_the_mend(
    config: RouterConfig, message: str
) -> None:
    with pytest.raises(RouterError) as caught:
        run(config, lambda: None, threading.Event())
    assert str(caught.value) == message


def test_an_edge_without_its_certificate_is_told_which_file_is_missing(tmp_path: Path) -> None:
    config = RouterConfig(free_endpoint(), ("tls/192.0.2.1:7447",), Link.EDGE, access=tmp_path)
    (tmp_path / "ca.pem").touch()
    with pytest.raises(SecretError, match=r"edge\.pem: there is no such file: TLS takes it"):
        run(config, lambda: None, threading.Event())


def test_a_link_carries_what_roles_say_to_each_other_and_an_edge_what_people_say() -> None:
    alone = access_control(["local"], tls=True)
    control = allow_links(alone, ["local"])
    added = [rule for rule in control["rules"] if rule not in alone["rules"]]
    verbs = ("publishes", "subscribes", "serves", "asks", "announces", "watches")
    for link, roles in ((Link.ROUTER, None), (Link.EDGE, EDGE_ROLES)):
        allowed = {
            key
            for rule in added
            if rule["id"].startswith(link.value) and rule["permission"] == "allow"
            for key in rule["key_exprs"]
        }
        nodes = [node for node in topology(KEYS) if roles is None or node.role in roles]
        said = {key for node in nodes for verb in verbs for key in getattr(node, verb)}
        assert allowed == said | {router_key()}
    assert control["subjects"][len(alone["subjects"]) :] == [
        {"id": "router", "cert_common_names": ["router"]},
        {"id": "edge", "cert_common_names": ["edge"]},
    ]
    assert (control["default_permission"], control["enabled"]) == ("deny", True)
    denied = [rule["key_exprs"] for rule in added if rule["permission"] == "deny"]
    assert denied == [[KEYS.control(teacher="operator")]]


def test_an_edge_serves_what_gateways_serve_asks_what_people_ask_and_publishes_nothing() -> None:
    control = allow_links(access_control(["local"], tls=True), ["local"])
    may: dict[tuple[str, str], set[str]] = {}
    for rule in control["rules"]:
        if rule["id"].startswith(Link.EDGE.value) and rule["permission"] == "allow":
            for flow in rule["flows"]:
                for message in rule["messages"]:
                    may.setdefault((flow, message), set()).update(rule["key_exprs"])
    served = {KEYS.status("gateway"), CROWD.status("gateway"), router_key()}
    asked = {KEYS.join(), KEYS.answer(), KEYS.control(), CROWD.join(), CROWD.answer()} | served
    came = {flow_message[1]: keys for flow_message, keys in may.items() if flow_message[0] == "ingress"}
    news = {keys.decision() for keys in (KEYS, CROWD)} | {keys.measures() for keys in (KEYS, CROWD)}
    tokens = {key for keys in (KEYS, CROWD) for key in (keys.presences(), keys.service("gateway"))}
    assert came == {
        "query": asked,
        "declare_queryable": served,
        "reply": served,
        "declare_subscriber": news,
        "liveliness_token": tokens,
    }
