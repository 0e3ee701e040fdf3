"""Whose token is whose: one who is sent away is not taken for another who stays."""

import pytest

from services.runtime.roll import Roll, run_of

PLACE = ("s1", "ann")


@pytest.fixture
def roll() -> Roll:
    return Roll(one_each=True)


@pytest.mark.parametrize("program, run", [("services.client#8f0a", "8f0a"), ("sfid page", ""), ("", "")])
def test_a_program_says_which_run_it_is_or_does_not(program: str, run: str) -> None:
    assert run_of(program) == run


def test_the_token_of_one_who_was_sent_away_is_nobodys_leaving(roll: Roll) -> None:
    roll.let_in(PLACE, "b")
    assert not roll.show(PLACE, "a")
    assert not roll.is_here(PLACE)
    assert roll.show(PLACE, "b")
    assert not roll.take_back(PLACE, "a")
    assert roll.is_here(PLACE)
    assert roll.has_let_in_another(PLACE, "a")
    assert roll.take_back(PLACE, "b")
    assert (roll.is_here(PLACE), roll.has_let_in_another(PLACE, "a")) == (False, False)


def test_whoever_is_sent_away_may_leave_before_the_other_shows_a_token(roll: Roll) -> None:
    roll.show(PLACE, "a")
    roll.let_in(PLACE, "b")
    assert not roll.take_back(PLACE, "a")
    assert roll.has_let_in_another(PLACE, "a")


def test_a_token_without_a_run_counts_for_whoever_is_there(roll: Roll) -> None:
    roll.let_in(PLACE, "a")
    assert roll.show(PLACE, "")
    assert roll.is_here(PLACE)
    assert not roll.has_let_in_another(PLACE, "")
    assert roll.take_back(PLACE, "")


def test_who_has_two_tokens_is_here_until_both_are_gone(roll: Roll) -> None:
    for run in ("", "a"):
        roll.show(PLACE, run)
    assert not roll.take_back(PLACE, "")
    assert roll.take_back(PLACE, "a")
    assert not roll.is_here(PLACE)


def test_names_and_sessions_are_apart(roll: Roll) -> None:
    roll.show(PLACE, "a")
    roll.let_in(PLACE, "a")
    for other in (("s1", "bob"), ("s2", "ann")):
        assert not roll.has_let_in_another(other, "b")
        roll.show(other, "b")
        assert roll.take_back(other, "b")
    assert roll.is_here(PLACE)
    assert roll.has_let_in_another(PLACE, "b")


def test_a_run_that_is_forgotten_is_waited_for_no_longer(roll: Roll) -> None:
    roll.let_in(PLACE, "a")
    roll.forget(PLACE)
    assert not roll.has_let_in_another(PLACE, "b")


def test_one_person_at_two_screens_is_here_until_both_are_closed() -> None:
    roll = Roll(one_each=False)
    for run in ("a", "b"):
        roll.let_in(PLACE, run)
        assert roll.show(PLACE, run)
    assert not roll.has_let_in_another(PLACE, "a")
    assert not roll.take_back(PLACE, "b")
    assert roll.take_back(PLACE, "a")
