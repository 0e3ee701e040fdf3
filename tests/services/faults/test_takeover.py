"""Three learners at two routers, one of them killed: the share of CI (takeover.py: the full number)."""

import sys
from pathlib import Path

import pytest

from tests.services.faults.takeover import broken, kill_one

SESSIONS = 30
SECONDS = 2.0


@pytest.mark.real
def test_the_sessions_of_a_killed_learner_go_on_in_the_others_and_nothing_is_lost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = kill_one(SESSIONS, 3, SECONDS, tmp_path)
    with capsys.disabled():
        sys.stdout.write(f"\ntakeover: {found._asdict()}\n")
    assert broken(found) == {}
    assert (found.sessions, found.moved) == (SESSIONS, 17)
    assert found.listed >= SESSIONS - found.moved
    assert found.acknowledged_after >= 3 * SESSIONS
