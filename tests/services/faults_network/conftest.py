"""One deployment for all tests of a module, and where their results are kept."""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict

import pytest

from tests.services.cli.command_line import sfid
from tests.services.faults.campaigns import Result
from tests.services.faults_network.rig import Rig, deployed

Tell = Callable[..., None]
CACHE = "fault-results"
"""Place of the results in pytest's cache."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A deployment that outlives each fault; at its end every row is proven and every table replays."""
    root = tmp_path_factory.mktemp("rig")
    with deployed(root) as made:
        yield made
        for role in ("learner", "environment", "router"):
            process = made.processes[role]
            process.terminate()
            assert process.wait(15) == 0, f"{role} drains"
    verified = sfid("verify", str(root / "data"))
    assert verified.code == 0, verified.stderr
    replayed = sfid("replay", str(root / "data"), "--verify", "--json")
    assert replayed.code == 0, replayed.stderr
    assert all(one["matches"] for one in json.loads(replayed.stdout)["sessions"])


@pytest.fixture
def tell(request: pytest.FixtureRequest) -> Tell:
    """Write down a fault, its promise and what came of it, as the published table takes it.

    It goes to the cache of the run; `python -m tests.services.faults_network.store` keeps it.
    """

    def write(fault: str, promise: str, count: int, unit: str, result: str, *, holds: bool = True) -> None:
        test = request.node
        name = re.sub(r"[^a-z0-9]+", "-", f"network {test.name.removeprefix('test_')}".lower()).strip("-")
        path = f"{test.path.relative_to(request.config.rootpath).as_posix()}::{test.originalname}"
        row = Result(name, fault, promise, path, count, unit, result, holds)
        cache: pytest.Cache | None = getattr(request.config, "cache", None)
        if cache is not None:
            cache.set(f"{CACHE}/{name}", asdict(row))

    return write
