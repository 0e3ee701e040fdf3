"""Three learners at two routers, one of them killed: the share of CI (takeover.py: the full number)."""

import sys
from pathlib import Path

import pytest

from tests.services.faults.takeover import BACK_MS_MAX, broken, kill_one

SECONDS = 2.0


@pytest.mark.real
@pytest.mark.parametrize("victim,sessions,moved", [("learner", 30, 8), ("router", 9, 7)])
def test_the_sessions_of_a_killed_learner_or_router_go_on_in_the_others_and_nothing_is_lost(
    victim: str, sessions: int, moved: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = kill_one(sessions, 3, SECONDS, tmp_path, victim)
    with capsys.disabled():
        sys.stdout.write(f"\ntakeover from a {victim}: {found._asdict()}\n")
    assert broken(found, BACK_MS_MAX[victim]) == {}
    assert (found.sessions, found.moved) == (sessions, moved)
    assert found.listed >= sessions - found.moved
    assert found.acknowledged_after >= 3 * sessions
