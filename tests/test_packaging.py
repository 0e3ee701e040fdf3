"""What is shipped: a wheel of three packages and nothing else, locks that hold."""

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
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

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
