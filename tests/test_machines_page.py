"""MACHINES.md: what it names is there, and its sums are right."""

import re
import subprocess
from pathlib import Path

import pytest
import yaml

from services.runtime.zenoh_config import LinkLimits
from tests.services.cli.command_line import sfid
from tests.test_security_page import known_tests

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "MACHINES.md").read_text(encoding="utf-8")
CAPACITY = PAGE.partition("## How much it carries")[2]
LEARNER_MS, ENVIRONMENT_MS, TEACHERS_MS, ROUTER_MS, LINKED_MS, GATEWAY_MS = 0.62, 0.09, 0.23, 0.39, 0.19, 0.6


def test_every_test_and_file_that_the_page_names_exists() -> None:
    assert set(re.findall(r"`(test_\w+)`", PAGE)) - known_tests() == set()
    named = re.findall(r"(?:tests|services)/[\w/]+\.py", PAGE)
    assert [name for name in named if not (ROOT / name).is_file()] == []
    modules = re.findall(r"python -m (tests[\w.]+\w)", PAGE)
    assert modules
    assert [name for name in modules if not (ROOT / f"{name.replace('.', '/')}.py").is_file()] == []


def test_the_command_for_a_teacher_is_the_one_that_the_page_goes_on_with(tmp_path: Path) -> None:
    (new,) = re.findall(r"^ {4}sfid (keys new .+)$", PAGE, re.MULTILINE)
    (teach,) = re.findall(r"^ {4}(sfid teach keyboard .+)$", PAGE, re.MULTILINE)
    done = sfid(*new.split(), cwd=tmp_path)
    assert done.code == 0, done.stderr
    assert f"they teach with `{teach}`" in done.stdout.splitlines()


def test_machines_are_set_as_containers_are(tmp_path: Path) -> None:
    block = PAGE.partition("\n## A router that moves\n")[2].partition("\n## ")[0]
    write, load = re.findall(r"^ {4}(.+)$", block, re.MULTILINE)
    path = write.rpartition(" > ")[2]
    subprocess.run(["bash", "-ec", write.replace("/etc/sysctl.d", str(tmp_path))], check=True)
    compose = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))
    assert (tmp_path / Path(path).name).read_text().split() == compose["x-service"]["sysctls"]
    assert load == f"sysctl -p {path}"
    told = re.findall(r"^\| `(tcp_\w+)` \|[^|]*\| (\d+): ", block, re.MULTILINE)
    assert [f"net.ipv4.{name}={value}" for name, value in told] == compose["x-service"]["sysctls"]


def test_every_cost_of_the_capacity_says_how_it_is_known() -> None:
    rows = re.findall(r"^\| ([a-z][^|]*) \|[^|]*\|[^|]*\| ([MSX]): [^|]+ \|$", CAPACITY, re.MULTILINE)
    table = CAPACITY.partition("| part |")[2].partition("\n\n")[0]
    assert len(rows) == table.count("\n") - 1
    assert {kind for _, kind in rows} == {"M", "S", "X"}


@pytest.mark.parametrize("teachers", [1_000, 3_400, 10_000, 100_000])
def test_the_plan_follows_from_the_costs(teachers: int) -> None:
    row = re.search(rf"^\| {teachers:,} \|(.*)$", CAPACITY, re.MULTILINE)
    assert row is not None
    deployments, learners, edges, gateways, cores = (int(cell) for cell in row[1].split("|")[:5])
    lab_ms = LINKED_MS + ROUTER_MS - TEACHERS_MS
    for parts, cores_each, label_ms in (
        (deployments, 2, lab_ms),
        (deployments, 1, ENVIRONMENT_MS),
        (learners, 1, LEARNER_MS),
        (edges, 2, TEACHERS_MS),
        (gateways, 1, GATEWAY_MS),
    ):
        # To a twentieth: a learner that is full at 970 holds the thousand of the page.
        assert teachers * label_ms / 1000 <= parts * cores_each * 0.6 * 1.05
    assert teachers / edges <= LinkLimits().sessions_max
    busy = teachers * (LEARNER_MS + ENVIRONMENT_MS + lab_ms + TEACHERS_MS + GATEWAY_MS) / 1000
    assert busy / 0.8 == pytest.approx(cores, rel=0.3)
