"""A crowd's room in a directory of its own."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.services.aggregator.crowd_room import CrowdRoom


@pytest.fixture
def crowd_room(tmp_path: Path) -> Iterator[CrowdRoom]:
    made = CrowdRoom(tmp_path / "data")
    yield made
    made.close()
