"""Which bridges are told to keep their address."""

import json
import stat
from pathlib import Path

from tests.containers.bridges import keep_bridge_addresses, pinning
from tests.containers.engine import Engine, Stack
from tests.containers.test_aftermath import FAKE

ANSWERS = {
    "network ls --filter name=p_ ": ("p_bus\np_pages\np_other\n", "", 0),
    "network inspect p_bus": ("no-such-bridge7\n", "", 0),
    "network inspect p_pages": ("gone9\n", "", 0),
}


def stack(folder: Path, name: str) -> Stack:
    tool = folder / name
    tool.write_text(FAKE)
    tool.chmod(tool.stat().st_mode | stat.S_IXUSR)
    tool.with_suffix(".json").write_text(json.dumps(ANSWERS))
    return Stack(Engine(str(tool), ()), "p", {})


def test_each_bridge_of_this_machine_is_set_to_the_address_that_it_has(tmp_path: Path) -> None:
    interface = tmp_path / "net" / "no-such-bridge7"
    interface.mkdir(parents=True)
    (interface / "address").write_text("06:32:36:52:79:5b\n")
    assert pinning(stack(tmp_path, "podman"), tmp_path / "net") == [
        ("ip", "link", "set", "dev", "no-such-bridge7", "address", "06:32:36:52:79:5b")
    ]


def test_nothing_is_done_where_the_engine_sets_addresses_itself_or_has_its_bridges_elsewhere(
    tmp_path: Path,
) -> None:
    assert pinning(stack(tmp_path, "docker")) == []
    assert keep_bridge_addresses(stack(tmp_path, "podman")) == []
