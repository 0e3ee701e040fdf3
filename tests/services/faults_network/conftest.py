"""One deployment for all tests of a module, and where their results are kept."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.services.cli.command_line import sfid
from tests.services.faults_network.rig import Rig, deployed

Tell = Callable[..., None]


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
    """Write down a fault, its promise and what came of it: a line of JSON for the published table."""

    def write(fault: str, promise: str, count: int, result: str) -> None:
        line = {
            "fault": fault, "promise": promise, "test": request.node.nodeid, "count": count, "result": result
        }  # fmt: skip
        cache: pytest.Cache | None = getattr(request.config, "cache", None)
        if cache is not None:
            kept = Path(str(cache.mkdir("fault-results"))) / "network.jsonl"
            with kept.open("a") as file:
                file.write(json.dumps(line) + "\n")

    return write
