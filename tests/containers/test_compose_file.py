"""compose.yaml and Dockerfile as they are written: shut, and as the topology has it."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.main import get_command

from services.cli.main import app
from services.operations.status import USUAL_NAMES
from services.topology import Role

ROOT = Path(__file__).parents[2]
PACKAGES = {"sfid_core", "protocol", "services"}
NOBODY = "10001:10001"
VERBS = {"aggregate": Role.AGGREGATOR, "session": Role.OPERATOR, "status": Role.OPERATOR}
"""Commands that are not called as the role that they take; `teach` takes that of its second word."""
COME_AND_GO = {Role.OPERATOR, Role.TEACHER, Role.WORKER}
AT_HOME = {Role.STUDY}
"""A study is run by a person, on their machine."""
LOOPBACK = "127.0.0.1:"
VARIABLE = re.compile(r"\$\{(\w+):-([^}]*)\}")


def compose() -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))
    return document


SERVICES: dict[str, dict[str, Any]] = compose()["services"]


def role_of(service: dict[str, Any]) -> Role:
    """Return as whom a container comes to the router."""
    verb, *words = service["command"]
    if verb == "teach":
        return Role.WORKER if words[0] == "crowd" else Role.TEACHER
    return VERBS.get(verb) or Role(verb)


def lasting() -> dict[str, Role]:
    """The containers that are services: they come without a profile."""
    return {name: role_of(service) for name, service in SERVICES.items() if "profiles" not in service}


@pytest.mark.parametrize("name", sorted(SERVICES))
def test_a_container_runs_without_privileges_on_a_root_it_cannot_write(name: str) -> None:
    service = SERVICES[name]
    kept = {
        key: service.get(key)
        for key in [
            "user",
            "read_only",
            "cap_drop",
            "security_opt",
            "privileged",
            "cap_add",
            "devices",
            "pid",
        ]
    }
    assert kept == {
        "user": NOBODY,
        "read_only": True,
        "cap_drop": ["ALL"],
        "security_opt": ["no-new-privileges:true"],
        "privileged": None,
        "cap_add": None,
        "devices": None,
        "pid": None,
    }


def test_every_service_of_the_topology_has_its_container_and_nothing_else_runs_by_itself() -> None:
    """People, operators and studies come and go; who of them is in the file has a profile."""
    assert sorted(role.value for role in lasting().values()) == sorted(
        role.value for role in set(Role) - COME_AND_GO - AT_HOME
    )
    assert {role_of(service) for service in SERVICES.values()} == set(Role) - AT_HOME


def test_a_container_holds_the_login_of_its_role_and_no_other_and_cannot_write_it() -> None:
    found = {
        name: [volume for volume in service["volumes"] if "login" in volume]
        for name, service in SERVICES.items()
        if name != "router"
    }
    assert found == {
        name: [f"login-{role_of(service).value}:/access:ro"]
        for name, service in SERVICES.items()
        if name != "router"
    }


def test_only_the_learner_holds_the_journal_and_only_the_router_makes_logins() -> None:
    kept = {
        name: [volume for volume in service["volumes"] if not volume.endswith(":ro")]
        for name, service in SERVICES.items()
    }
    logins = [role.value for role in Role if role not in {Role.ROUTER, Role.STUDY}]
    router = kept.pop("router")
    assert sorted(router) == sorted(["logins:/logins", *(f"login-{one}:/logins/{one}" for one in logins)])
    assert {name: volumes for name, volumes in kept.items() if volumes} == {
        "learner": ["journal:/data"],
        "monitor": ["recordings:/data"],
        "gateway": ["page:/data"],
        "aggregator": ["crowd:/data"],
    }


def test_no_secret_stands_in_a_command_or_in_the_environment() -> None:
    environments = [service["environment"] for service in SERVICES.values()]
    assert {name for environment in environments for name in environment} == {
        "SFID_CONNECT",
        "SFID_ACCESS",
        "SFID_INSECURE_NETWORK",
        "RES_OPTIONS",
    }
    assert {environment["SFID_ACCESS"] for environment in environments} == {"/access", "/logins"}
    words = [word for service in SERVICES.values() for word in service["command"]]
    assert [word for word in words if re.search(r"token|secret|password|[0-9a-f]{16}", word)] == []


def test_only_pages_are_reachable_and_from_this_machine_only() -> None:
    published = {name: service["ports"] for name, service in SERVICES.items() if "ports" in service}
    outside = {name for name, service in SERVICES.items() if service["networks"] != ["bus"]}
    assert outside == set(published) == {"monitor", "gateway"}
    ports = [port for name in published for port in published[name]]
    assert [port for port in ports if not port.startswith(LOOPBACK)] == []
    assert compose()["networks"]["bus"] == {"internal": True}
    shared = [name for name, service in SERVICES.items() if "network_mode" in service]
    assert shared == []


def test_who_is_on_two_networks_may_ask_for_the_bare_name_of_the_router() -> None:
    """Of two name servers of Podman's, the one that is not the bus's knows no other."""
    bare = {
        name
        for name, service in SERVICES.items()
        if "no-tld-query" not in service["environment"]["RES_OPTIONS"]
    }
    assert bare == {name for name, service in SERVICES.items() if len(service["networks"]) > 1}


def test_a_port_that_is_chosen_is_the_one_that_the_page_is_told() -> None:
    """Inside, outside, and in the link that a browser gets, for every variable of a port."""
    for name in ("monitor", "gateway"):
        service = SERVICES[name]
        published = {variable for port in service["ports"] for variable, _ in VARIABLE.findall(port)}
        told = {variable for word in service["command"] for variable, _ in VARIABLE.findall(word)}
        assert published == told
        assert published


def test_every_service_is_asked_how_it_does_under_its_own_login() -> None:
    asked = {
        name: service["healthcheck"]["test"] for name, service in SERVICES.items() if "healthcheck" in service
    }
    assert asked == {name: ["CMD", "sfid", "health", role.value] for name, role in lasting().items()}
    assert {role.value for role in lasting().values()} == {"router", *USUAL_NAMES}


def test_every_container_runs_a_command_that_there_is_with_options_that_it_has() -> None:
    top: Any = get_command(app)
    wrong = []
    for name, service in SERVICES.items():
        command, words = top, list(service["command"])
        while hasattr(command, "commands"):
            command = command.commands[words.pop(0)]
        known = {option for parameter in command.params for option in parameter.opts}
        given = {word.partition("=")[0] for word in words if word.startswith("--")}
        wrong += [(name, option) for option in sorted(given - known)]
    assert wrong == []


def test_what_to_name_where_there_are_no_profiles_is_every_service() -> None:
    """The header says what to type for a tool that would start the demo and the crowd as well."""
    text = (ROOT / "compose.yaml").read_text(encoding="utf-8")
    (line,) = re.findall(r"#   podman-compose up -d ([a-z ]+) \[", text)
    assert line.split() == list(lasting())


def test_the_images_start_sfid_itself_as_an_unprivileged_user() -> None:
    lines = (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if line.startswith(("USER", "ENTRYPOINT"))] == [
        f"USER {NOBODY}",
        'ENTRYPOINT ["sfid"]',
    ]


def test_an_image_has_a_place_for_the_login_of_every_role_that_is_handed_one() -> None:
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    places = {f"/logins/{role.value}" for role in Role if role not in {Role.ROUTER, Role.STUDY}}
    assert set(re.findall(r"/logins/[a-z]+", text)) == places


def test_only_the_image_that_watches_has_the_viewer() -> None:
    """Which lock lacks it is a test of the locks."""
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    stages = dict(re.findall(r"FROM \S+ AS (\S+)\n((?:(?!FROM ).*\n?)*)", text))
    assert "requirements-services.lock" in stages["dependencies-service"]
    assert "requirements-monitor.lock" in stages["dependencies-monitor"]
    assert {name: service["build"]["target"] for name, service in SERVICES.items() if name != "monitor"} == {
        name: "service" for name in SERVICES if name != "monitor"
    }
    assert SERVICES["monitor"]["build"]["target"] == "monitor"


def test_an_image_is_sent_nothing_but_what_it_is_built_from() -> None:
    """Journals and virtual environments lie beside the sources; none of them may reach an image."""
    lines = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    rules = [line for line in lines if line and not line.startswith("#")]
    assert rules[0] == "*"
    assert {rule.strip("!/") for rule in rules if rule.startswith("!")} == {
        *PACKAGES,
        "pyproject.toml",
        "README.md",
        "LICENSE",
        "requirements-*.lock",
    }
