"""A client with a login and a token of its own speaks in nobody else's name."""

from pathlib import Path

import pytest

from tests.services.security.attack import attacked

pytestmark = pytest.mark.real

ATTEMPTS = 10_000
"""Of 17 kinds; `python -m tests.services.security.attack --attempts N` makes as many as you like."""


def test_of_10_000_attempts_to_speak_as_another_none_has_any_effect(tmp_path: Path) -> None:
    result = attacked(tmp_path / "data", ATTEMPTS)
    assert (result.attempts, len(result.tried)) == (ATTEMPTS, 17)
    assert min(result.tried.values()) >= ATTEMPTS // 17
    assert result.answered_well == {}
    assert (result.labels_in_anothers_name, result.labels_of_the_attacker) == (0, 0)
    assert (result.acknowledgements_disbelieved, result.overheard, result.injected) == (0, 0, 0)
    assert result.paused is False
    assert result.honest_acknowledged > 10
    assert result.honest_lost == 0


def test_the_same_attempts_succeed_where_the_router_asks_nobody_so_it_is_the_router_that_stops_them(
    tmp_path: Path,
) -> None:
    result = attacked(tmp_path / "data", 340, guarded=False)
    assert result.injected > 0
    assert {"read the journal", "list sessions"} <= result.answered_well.keys()
    # Tokens and keyed acknowledgements hold without the router.
    assert (result.labels_in_anothers_name, result.labels_of_the_attacker, result.honest_lost) == (0, 0, 0)
