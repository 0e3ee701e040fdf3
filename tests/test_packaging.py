"""What is shipped: a wheel of three packages and nothing else, locks that hold, containers that are shut."""

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from typer.main import get_command

from services.cli.main import app
from services.topology import Role

ROOT = Path(__file__).parent.parent
PACKAGES = {"sfid_core", "protocol", "services"}
LOCKS = ["requirements.lock", "requirements-monitor.lock", "requirements-services.lock"]
VIEWER = {"rerun-sdk", "pyarrow"}
NOT_SHIPPED = {".md", ".pyc", ".png"}


# --- the wheel ---


@pytest.fixture(scope="session")
def wheel_names(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """The names in a wheel built, offline, from a copy of the sources."""
    source = tmp_path_factory.mktemp("source")
    for package in [*PACKAGES, "tests"]:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ["pyproject.toml", "README.md", "LICENSE"]:
        shutil.copy(ROOT / name, source)
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--no-index",
        "--no-build-isolation",
    ]
    built = subprocess.run(
        [*command, "--wheel-dir", "dist", "."], cwd=source, capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    (wheel,) = (source / "dist").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def test_the_wheel_holds_the_three_packages_and_nothing_else(wheel_names: set[str]) -> None:
    top = {name.split("/")[0] for name in wheel_names}
    (metadata,) = {name for name in top if name.endswith(".dist-info")}
    assert top - {metadata} == PACKAGES
    assert f"{metadata}/licenses/LICENSE" in wheel_names


def test_all_of_the_packages_but_prose_pictures_and_golden_bytes_is_in_the_wheel(
    wheel_names: set[str],
) -> None:
    expected = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and path.suffix not in NOT_SHIPPED and "vectors" not in path.parts
    }
    assert {f"{package}/py.typed" for package in PACKAGES} <= expected
    assert sorted(expected - wheel_names) == []


def test_the_packaged_levels_are_in_the_wheel(wheel_names: set[str]) -> None:
    assert {name for name in wheel_names if name.startswith("sfid_core/sokoban/levels/")}


def test_the_three_packages_belong_to_this_distribution_alone() -> None:
    owners = packages_distributions()
    assert {package: set(owners[package]) for package in PACKAGES} == {
        package: {"sfid"} for package in PACKAGES
    }


# --- the locks ---


def project() -> dict[str, Any]:
    table: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return table


def locked(lock: str) -> list[Requirement]:
    """The pinned requirements of a lock, without their hashes."""
    lines = (ROOT / lock).read_text(encoding="utf-8").splitlines()
    return [Requirement(line.rstrip("\\ ")) for line in lines if re.match(r"[A-Za-z0-9]", line)]


def missing_from(lock: str, requirements: list[str]) -> list[str]:
    """Requirements that no pin of the lock fulfils."""
    pins: dict[str, list[str]] = {}
    for pin in locked(lock):
        pins.setdefault(canonicalize_name(pin.name), []).append(str(pin.specifier).removeprefix("=="))
    wanted = [Requirement(line) for line in requirements]
    return [
        str(requirement)
        for requirement in wanted
        if requirement.name != "sfid"
        and not any(
            requirement.specifier.contains(version)
            for version in pins.get(canonicalize_name(requirement.name), [])
        )
    ]


def test_the_lock_fulfils_every_dependency_and_extra() -> None:
    extras = project()["optional-dependencies"]
    everything = [*project()["dependencies"], *(line for lines in extras.values() for line in lines)]
    assert missing_from("requirements.lock", everything) == []


def test_the_lock_of_a_watching_image_fulfils_every_dependency() -> None:
    extras = project()["optional-dependencies"]
    assert missing_from("requirements-monitor.lock", [*project()["dependencies"], *extras["metrics"]]) == []


def test_the_lock_of_the_other_images_leaves_out_the_viewer_alone() -> None:
    dependencies = project()["dependencies"]
    assert [Requirement(line).name for line in missing_from("requirements-services.lock", dependencies)] == [
        "rerun-sdk"
    ]
    assert {pin.name for pin in locked("requirements-services.lock")} & VIEWER == set()


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_names_the_same_versions_as_the_full_one(lock: str) -> None:
    assert {str(pin) for pin in locked(lock)} <= {str(pin) for pin in locked("requirements.lock")}


@pytest.mark.parametrize("lock", LOCKS)
def test_every_pin_of_a_lock_is_exact_and_carries_hashes(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    entries = [entry for entry in re.split(r"\n(?=\S)", text.strip()) if not entry.startswith("#")]
    assert entries
    assert [
        entry
        for entry in entries
        if not re.match(r"[\w.-]+==[^\s]+[^\\]*\\\n +--hash=sha256:[0-9a-f]{64}", entry)
    ] == []


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_names_no_index(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    assert re.findall(r".*(?://|index|find-links|trusted-host).*", text) == []


# --- the containers ---


def compose() -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))
    return document


@pytest.mark.parametrize("name", sorted(compose()["services"]))
def test_a_container_runs_without_privileges_on_a_root_it_cannot_write(name: str) -> None:
    service = compose()["services"][name]
    kept = {
        key: service.get(key)
        for key in ["user", "read_only", "cap_drop", "security_opt", "privileged", "cap_add"]
    }
    assert kept == {
        "user": "10001:10001",
        "read_only": True,
        "cap_drop": ["ALL"],
        "security_opt": ["no-new-privileges:true"],
        "privileged": None,
        "cap_add": None,
    }


def test_only_pages_are_reachable_and_from_this_machine_only() -> None:
    document = compose()
    published = {
        name: service["ports"] for name, service in document["services"].items() if "ports" in service
    }
    outside = {name for name, service in document["services"].items() if service["networks"] != ["bus"]}
    assert list(published) == ["monitor", "gateway"]
    ports = [port for name in published for port in published[name]]
    assert [port for port in ports if not port.startswith("127.0.0.1:")] == []
    assert document["networks"]["bus"] == {"internal": True}
    assert outside == {"monitor", "gateway"}


def test_only_the_learner_holds_the_journal_and_only_the_router_makes_logins() -> None:
    services = compose()["services"]
    logins = "access:/access:ro"
    assert {name: service["volumes"] for name, service in services.items()} == {
        "router": ["access:/access"],
        "environment": [logins],
        "learner": [logins, "journal:/data"],
        "monitor": [logins, "recordings:/data"],
        "gateway": [logins, "page:/data"],
        "aggregator": [logins, "crowd:/data"],
        "session": [logins],
        "teacher": [logins],
    }


def test_every_container_runs_a_command_that_there_is_with_options_that_it_has() -> None:
    top: Any = get_command(app)
    wrong = []
    for name, service in compose()["services"].items():
        command, words = top, list(service["command"])
        while hasattr(command, "commands"):
            command = command.commands[words.pop(0)]
        known = {option for parameter in command.params for option in parameter.opts}
        given = {word.partition("=")[0] for word in words if word.startswith("--")}
        wrong += [(name, option) for option in sorted(given - known)]
    assert wrong == []


def test_every_service_of_the_topology_has_its_container() -> None:
    """Those who talk on the bus by themselves; people, operators and studies come and go."""
    verbs = {service["command"][0] for service in compose()["services"].values()}
    running = {role.value for role in Role} - {Role.OPERATOR.value, Role.STUDY.value, Role.WORKER.value}
    spelt = {Role.AGGREGATOR.value: "aggregate", Role.TEACHER.value: "teach"}
    assert {spelt.get(role, role) for role in running} <= verbs


def test_the_images_start_sfid_itself_as_an_unprivileged_user() -> None:
    lines = (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if line.startswith(("USER", "ENTRYPOINT"))] == [
        "USER 10001:10001",
        'ENTRYPOINT ["sfid"]',
    ]


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
