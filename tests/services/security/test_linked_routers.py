"""Two routers over TLS: a role may do the same behind both, and a link is what its certificate says."""

import json
import queue
import shutil
import stat
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
import zenoh

from protocol.keys import Keys
from services.router import RouterConfig, free_endpoint
from services.router_links import Link
from services.runtime.access import Access, Guard, access_for, certificates, make_access, read_access
from services.runtime.bus import BusError, Presence, Received, Reply, Request
from services.runtime.zenoh_bus import ZenohBus, ZenohRouter, open_bus
from services.topology import Role
from tests.services.cli.command_line import sfid, wait_for
from tests.services.linked import (
    DEADLINE_S,
    ask,
    ask_until_served,
    bus_of,
    carried,
    certified,
    routing,
    tls_endpoint,
)

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed"),
]
KEYS, CROWD = Keys("local"), Keys("local-crowd")
ROUTES_S = 0.3
"""Routes are computed 0.1 s after a link came; who is denied everything cannot see when."""
VERBS = ("create", "branch", "list", "show", "rows")
CLIENTS = [role for role in Role if role is not Role.ROUTER]


def answering(word: bytes) -> Callable[[Request], None]:
    return lambda request: request.reply(word)


@dataclass
class Place:
    """A router, the directory of what may come to it, and buses there."""

    endpoint: str
    folder: Path
    stack: ExitStack

    def bus(self, role: Role) -> ZenohBus:
        bus = bus_of(role, self.endpoint, self.folder)
        self.stack.callback(bus.close)
        return bus


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Certificates of all roles, and the logins of the lab's own network."""
    folder = certified(tmp_path_factory.mktemp("lab") / "access", *(role.value for role in Role), "edge")
    make_access(folder, [*(role.value for role in CLIENTS), *(link.value for link in Link)])
    return folder


@pytest.fixture
def lab(folder: Path) -> Iterator[Place]:
    """The learner's network."""
    endpoint = tls_endpoint()
    with ExitStack() as stack, routing(RouterConfig(endpoint, access=folder)):
        yield Place(endpoint, folder, stack)
        stack.close()


@contextmanager
def beside(lab: Place, there: Path, link: Link) -> Iterator[Place]:
    """Another network, linked to the lab's: of the lab's logins it has the link's alone."""
    roles = [role.value for role in Role if role is not Role.ROUTER]
    folder = carried(lab.folder, there / link.value, link.value)
    for role in roles:
        for ending in ("pem", "key"):
            shutil.copy(lab.folder / f"{role}.{ending}", folder)
    endpoint = tls_endpoint()
    config = RouterConfig(endpoint, connect=(lab.endpoint,), link=link, access=folder)
    with ExitStack() as stack, routing(config):
        yield Place(endpoint, folder, stack)
        stack.close()


@contextmanager
def taken_over(lab: Place, link: str, certificate: str) -> Iterator[str]:
    """A router in wrong hands, with a login and a certificate: it lets everybody in to do anything."""
    endpoint = free_endpoint()
    users = lab.folder / "users"
    everything: dict[str, object] = {"enabled": False}
    guard = Guard(users, everything, certificates(lab.folder, certificate), read_access(lab.folder, link))
    router = ZenohRouter(endpoint, "it listens", guard=guard, connect=(lab.endpoint,))
    try:
        wait_for("the link is there", lambda: bool(router.neighbours(100)))
        threading.Event().wait(ROUTES_S)
        yield endpoint
    finally:
        router.close()


@pytest.mark.parametrize("link", list(Link))
def test_a_teacher_in_another_network_is_asked_heard_and_seen_by_the_learner(
    lab: Place, tmp_path: Path, link: Link
) -> None:
    learner, seen = lab.bus(Role.LEARNER), queue.SimpleQueue[Presence]()
    learner.serve(KEYS.answer(), answering(b"saved"))
    learner.watch(KEYS.presences(), seen.put)
    with beside(lab, tmp_path, link) as town:
        assert read_access(town.folder, "teacher").password != read_access(lab.folder, "teacher").password
        teacher, heard = town.bus(Role.TEACHER), queue.SimpleQueue[Received]()
        teacher.subscribe(KEYS.decision(), heard.put)
        teacher.announce(KEYS.present("s1", "ann"))
        assert ask_until_served(teacher, KEYS.answer("s1", "ann")) == Reply(b"saved")
        learner.publish(KEYS.decision("s1"), b"LEFT or RIGHT?")
        assert heard.get(timeout=DEADLINE_S) == Received(KEYS.decision("s1"), b"LEFT or RIGHT?")
        assert seen.get(timeout=DEADLINE_S) == Presence(KEYS.present("s1", "ann"), present=True)
    assert seen.get(timeout=DEADLINE_S) == Presence(KEYS.present("s1", "ann"), present=False)


def test_services_work_together_from_behind_either_router(lab: Place, tmp_path: Path) -> None:
    with beside(lab, tmp_path, Link.ROUTER) as other:
        for one, two in ((lab, other), (other, lab)):
            one.bus(Role.ENVIRONMENT).serve(KEYS.environment("begin"), answering(b"world"))
            assert ask_until_served(two.bus(Role.LEARNER), KEYS.environment("begin")) == Reply(b"world")
            one.bus(Role.AGGREGATOR).serve(CROWD.answer(), answering(b"weighed"))
            assert ask_until_served(two.bus(Role.WORKER), CROWD.answer("s1", "w")) == Reply(b"weighed")
            one.stack.close()


def test_who_has_no_right_at_one_router_has_none_at_the_other(lab: Place, tmp_path: Path) -> None:
    learner, heard = lab.bus(Role.LEARNER), queue.SimpleQueue[Received]()
    learner.serve(KEYS.answer(), answering(b"learner"))
    learner.serve(KEYS.control(), answering(b"stopped"))
    lab.bus(Role.MONITOR).subscribe(KEYS.decision(), heard.put)
    with beside(lab, tmp_path, Link.ROUTER) as other:
        rogues = {role: other.bus(role) for role in CLIENTS if role is not Role.LEARNER}
        for role, rogue in rogues.items():
            for key in (KEYS.answer(), "sfid/**", "**"):
                rogue.serve(key, answering(role.value.encode()))
        teacher = other.bus(Role.TEACHER)
        ask_until_served(teacher, KEYS.answer("s1", "ann"))
        for rogue in rogues.values():
            rogue.publish(KEYS.decision("s1"), b"forged")
        for one in (lab.bus(Role.TEACHER), teacher):
            assert {ask(one, KEYS.answer("s1", f"t{number}")) for number in range(20)} == {Reply(b"learner")}
        assert ask(teacher, KEYS.control("s1", "ann")) == Reply(b"stopped")
        assert ask(teacher, KEYS.control("s1", "operator")) is None
        assert ask(other.bus(Role.OPERATOR), KEYS.control("s1", "operator")) == Reply(b"stopped")
        # What was forged went before: whoever asks over the same links has been overtaken by nothing.
        learner.publish(KEYS.decision("s1"), b"true")
        assert heard.get(timeout=DEADLINE_S).payload == b"true"
        assert heard.empty()


def harm_done(lab: Place, endpoint: str, access: Access | None) -> set[str]:
    """Try from behind a router that lets everything pass; return what of it reached the lab."""
    learner, heard = lab.bus(Role.LEARNER), queue.SimpleQueue[Received]()
    teacher = lab.bus(Role.TEACHER)
    teacher.subscribe(KEYS.decision(), heard.put)
    learner.serve(KEYS.control(), answering(b"stopped"))
    for verb in VERBS:
        learner.serve(KEYS.learner(verb), answering(b"done"))
    learner.serve(KEYS.join(), answering(b"welcome"))
    ask_until_served(teacher, KEYS.join("s1", "ann"))
    rogue = open_bus(endpoint, 5_000, access=access)
    rogue.serve(KEYS.answer(), answering(b"forged"))
    stopped = [ask(rogue, KEYS.control("s1", "operator")) for _ in range(3)]
    managed = {verb: ask(rogue, KEYS.learner(verb)) is not None for verb in VERBS}
    answered = [ask(teacher, KEYS.answer("s1", f"t{number}")) for number in range(20)]
    rogue.publish(KEYS.decision("s1"), b"forged")
    ask(rogue, KEYS.control("s1", "mallory"))  # comes back after what was published has passed
    learner.publish(KEYS.decision("s1"), b"true")
    words: list[bytes] = []
    while b"true" not in words:
        words.append(heard.get(timeout=DEADLINE_S).payload)
    rogue.close()
    done = {"answered": any(answered), "stopped": any(stopped), "published": b"forged" in words} | managed
    return {harm for harm, came in done.items() if came}


def linked(lab: Place, endpoint: str, access: Access) -> None:
    """Wait until what the lab's learner serves is known behind the other router, where it may be."""
    learner = lab.bus(Role.LEARNER)
    learner.serve(KEYS.answer("linked"), answering(b"linked"))
    teacher = open_bus(endpoint, 5_000, access=access)
    assert ask_until_served(teacher, KEYS.answer("linked", "ann")) == Reply(b"linked")
    teacher.close()
    lab.stack.close()


def test_an_edge_in_wrong_hands_may_do_what_teachers_may_and_a_router_is_trusted(lab: Place) -> None:
    anybody = read_access(lab.folder, "teacher")
    with taken_over(lab, "edge", "edge") as endpoint:
        linked(lab, endpoint, anybody)
        assert harm_done(lab, endpoint, anybody) == set()
        lab.stack.close()
    # The same attempts succeed from behind a router: so it is the edge's rules that stop them.
    with taken_over(lab, "router", "router") as endpoint:
        linked(lab, endpoint, anybody)
        assert harm_done(lab, endpoint, anybody) == {"answered", "stopped", "published", *VERBS}


def test_a_router_that_only_links_over_tls_lets_local_programs_in_by_their_logins(
    lab: Place, tmp_path: Path
) -> None:
    learner = lab.bus(Role.LEARNER)
    learner.serve(KEYS.answer(), answering(b"saved"))
    endpoint, folder = free_endpoint(), carried(lab.folder, tmp_path / "desk", "router")
    with ExitStack() as stack, routing(RouterConfig(endpoint, connect=(lab.endpoint,), access=folder)):
        desk = Place(endpoint, folder, stack)
        assert ask_until_served(desk.bus(Role.TEACHER), KEYS.answer("s1", "ann")) == Reply(b"saved")
        assert ask(desk.bus(Role.MONITOR), KEYS.answer("s1", "ann")) is None
        stack.close()


@pytest.mark.parametrize(
    "login,certificate", [("teacher", "teacher"), ("router", "teacher"), ("teacher", "learner")]
)
def test_who_has_no_routers_certificate_is_no_router(lab: Place, login: str, certificate: str) -> None:
    anybody = read_access(lab.folder, "teacher")
    with taken_over(lab, login, certificate) as endpoint:
        assert harm_done(lab, endpoint, anybody) == set()
        lab.stack.close()
        # It is none that another would wait for, and what others do goes on as before.
        learner = lab.bus(Role.LEARNER)
        learner.serve(KEYS.answer(), answering(b"saved"))
        assert ask_until_served(lab.bus(Role.TEACHER), KEYS.answer("s1", "ann")) == Reply(b"saved")


def test_with_a_clients_certificate_nobody_passes_for_the_router(
    folder: Path,
) -> None:
    endpoint = tls_endpoint()
    guard = Guard(folder / "users", {"enabled": False}, certificates(folder, "teacher"))
    router = ZenohRouter(endpoint, "it listens", guard=guard)
    try:
        with pytest.raises(BusError, match="lets this program in"):
            open_bus(endpoint, 0, access=access_for(endpoint, "learner", folder))
    finally:
        router.close()


def written(tmp_path: Path, name: str, *arguments: str) -> Path:
    """Return the file for a router of Zenoh's own that the command writes."""
    path = tmp_path / f"{name}.json5"
    done = sfid("router", *arguments, "--config-file", str(path))
    assert (done.code, done.stdout) == (0, ""), done.stderr
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    return path


def test_zenohs_own_routers_with_the_written_files_link_and_hold_the_rules(
    folder: Path, tmp_path: Path
) -> None:
    inner, outer = tls_endpoint(), tls_endpoint()
    town = carried(folder, tmp_path / "town", "edge", "teacher", "gateway", "worker")
    files = [
        written(tmp_path, "lab", "--listen", inner, "--access", str(folder)),
        written(tmp_path, "town", "--listen", outer, "--connect", inner, "--edge", "--access", str(town)),
    ]
    with ExitStack() as stack:
        for file in files:
            config = zenoh.Config.from_file(file)
            assert config.get_json("mode") == '"router"'
            stack.enter_context(zenoh.open(config))
        lab, far = Place(inner, folder, stack), Place(outer, town, stack)
        learner, heard = lab.bus(Role.LEARNER), queue.SimpleQueue[Received]()
        learner.serve(KEYS.answer(), answering(b"saved"))
        learner.serve(KEYS.control(), answering(b"stopped"))
        teacher = far.bus(Role.TEACHER)
        teacher.subscribe(KEYS.decision(), heard.put)
        assert ask_until_served(teacher, KEYS.answer("s1", "ann")) == Reply(b"saved")
        assert ask(teacher, KEYS.control("s1", "ann")) == Reply(b"stopped")
        assert ask(teacher, KEYS.control("s1", "operator")) is None
        far.bus(Role.GATEWAY).publish(KEYS.decision("s1"), b"forged")
        learner.publish(KEYS.decision("s1"), b"true")
        assert heard.get(timeout=DEADLINE_S).payload == b"true"


def test_what_is_printed_of_a_link_has_no_password_and_what_is_written_is_the_same_with_it(
    folder: Path, tmp_path: Path
) -> None:
    arguments = ("--listen", tls_endpoint(), "--connect", "tls/192.0.2.7:7447", "--access", str(folder))
    printed = json.loads(sfid("router", *arguments, "--config").stdout)
    whole = json.loads(written(tmp_path, "whole", *arguments).read_text())
    assert whole["connect"]["endpoints"] == ["tls/192.0.2.7:7447"]
    login = read_access(folder, "router")
    assert whole["transport"]["auth"]["usrpwd"] == {
        "dictionary_file": str(folder / "users"), "user": "router", "password": login.password,
    }  # fmt: skip
    for part in ("user", "password"):
        del whole["transport"]["auth"]["usrpwd"][part]
    assert printed == whole
    nowhere = tmp_path / "none" / "file"
    refused = sfid("router", *arguments, "--config-file", str(nowhere))
    assert (refused.code, refused.stderr) == (
        2,
        f"sfid: {nowhere}: No such file or directory: name a file in a directory that can be written\n",
    )
