"""A classroom in a directory of its own."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.services.learner.classroom import Classroom


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Classroom]:
    made = Classroom(tmp_path / "data")
    yield made
    made.shard.discard_pending()
    made.shard.close()
