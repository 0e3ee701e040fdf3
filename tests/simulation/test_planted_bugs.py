"""The checkers bite: each planted bug is found by the checker of the rule that it breaks."""

from pathlib import Path

import pytest

from services.simulate.campaign import campaign
from services.simulate.rules import RULES
from tests.simulation.planted import BUGS, Bug, plant, search


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: f"{bug.rule}: {bug.name}")
def test_a_planted_bug_is_found_by_the_checker_of_its_rule(bug: Bug, tmp_path: Path) -> None:
    found = search(bug, plant(bug, tmp_path))
    assert found.seed is not None, f"not found among {bug.seeds} seeds"
    assert found.seed < bug.seeds
    assert bug.rule in found.rules
    assert found.what


def test_without_a_bug_the_same_seeds_pass() -> None:
    failures = [
        failure for _, judged in campaign(0, max(bug.seeds for bug in BUGS)) for failure in judged.failures
    ]
    assert failures == []


def test_there_is_a_bug_for_every_rule() -> None:
    rules = {bug.rule for bug in BUGS}
    assert rules == {f"R{number}" for number in range(1, 11)}
    assert set(RULES) - {"R0"} <= rules
