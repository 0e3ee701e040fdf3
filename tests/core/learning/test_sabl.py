"""SABL against log-likelihoods computed by hand."""

import math

import pytest

from tests.core.learning.pupil import LEFT, RIGHT, S0, S1, UP, Pupil, rewards


def test_praise_blame_and_silence_computed_by_hand() -> None:
    """eps 0.2, mu+ 0.9, mu- 0.1: silence is p(0|right) = 0.8 * 0.9 + 0.2 * 0.1 = 0.74, p(0|wrong) = 0.26.

    Praise of UP: + ln(0.8 / 0.2). Blame of LEFT: - ln 4. Silence about RIGHT: + ln(0.74 / 0.26).
    Errors: 1 - 1/4 = 0.75 (all alike before); then LEFT has 1 of 4 + 3 = 7 parts: 0 - 1/7; silence 0.
    """
    pupil = Pupil("sabl", error=0.2, praise_silence=0.9, blame_silence=0.1)
    first = pupil.do(S0, UP, 0.0, rewards(0.5), S1)
    second = pupil.do(S0, LEFT, 0.0, rewards(-1.0), S1)
    third = pupil.do(S0, RIGHT, 0.0, (), S1)
    assert first == pytest.approx((0.75, 0.75, 0.5))
    assert second == pytest.approx((-1 / 7, -1 / 7, -1.0))
    assert third == (0.0, 0.0, 0.0)
    expected = [-math.log(4), math.log(0.74 / 0.26), math.log(4), 0]
    assert pupil.values(S0) == pytest.approx(expected)
    assert {pupil.choose(S0, decision) for decision in range(50)} == {UP}


def test_silence_says_nothing_when_praise_and_blame_are_as_rare() -> None:
    pupil = Pupil("sabl", praise_silence=0.5, blame_silence=0.5)
    pupil.do(S0, UP, 0.0, (), S1)
    assert pupil.values(S0) == pytest.approx([0, 0, 0, 0])


def test_it_explores_where_told_to() -> None:
    """A random action with probability 0.4: UP in 0.6 + 0.1 of the choices."""
    pupil = Pupil("sabl", explore=0.4)
    pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    chosen = [pupil.choose(S0, decision) for decision in range(4000)]
    assert chosen.count(UP) == pytest.approx(2800, abs=120)
