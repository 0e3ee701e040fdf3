"""PIES against updates computed by hand."""

import pytest

from tests.core.learning.pupil import LEFT, S0, S1, UP, Pupil, rewards


def test_advice_steers_the_choice_and_never_reaches_q() -> None:
    """alpha, beta, gamma 0.5, advice weighed over 2 episodes: xi = 1, 0.5, 0. Values shown: Q - xi * Phi.

    1. s0, UP, praise 1, r = 0, to s1:   Phi(s0, UP) = 0.5 * (-1 - 0) = -0.5;   Q(s0, UP) = 0
    2. s1, LEFT, blame -1, r = 4, solved: Phi(s1, LEFT) = 0.5 * (1 - 0) = 0.5;  Q(s1, LEFT) = 0.5 * 4 = 2
    """
    pupil = Pupil("pies", alpha=0.5, gamma=0.5, episodes=2)
    first = pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    second = pupil.do(S1, LEFT, 4.0, rewards(-1.0))
    assert first == (0.0, 0.0, 1.0)
    assert second == (4.0, 4.0, -1.0)
    assert (pupil.rounded(S0), pupil.rounded(S1)) == ([0, 0, 0.5, 0], [1.5, 0, 0, 0])
    assert {pupil.choose(S0, decision) for decision in range(50)} == {UP}
    pupil.begin(1)
    assert (pupil.rounded(S0), pupil.rounded(S1)) == ([0, 0, 0.25, 0], [1.75, 0, 0, 0])
    pupil.begin(2)
    assert (pupil.rounded(S0), pupil.rounded(S1)) == ([0, 0, 0, 0], [2, 0, 0, 0])
    assert {pupil.choose(S0, decision) for decision in range(50)} == {0, 1, 2, 3}


def test_with_a_discount_advice_counts_what_is_ahead() -> None:
    """beta and the discount of advice 0.5; in two episodes: s0, UP, praise; s1, LEFT, blame, the end.

    First:  Phi(s0, UP) = 0.5 * (-1 + 0.5 * 0 - 0) = -0.5;   Phi(s1, LEFT) = 0.5 * 1 = 0.5
    Second: Phi(s0, UP) = -0.5 + 0.5 * (-1 + 0.5 * 0.5 + 0.5) = -0.625
            Phi(s1, LEFT) = 0.5 + 0.5 * (1 - 0.5) = 0.75
    """
    pupil = Pupil("pies", gamma_advice=0.5, episodes=1000)
    for episode in range(2):
        pupil.begin(episode)
        pupil.do(S0, UP, 0.0, rewards(1.0), S1)
        pupil.do(S1, LEFT, 0.0, rewards(-1.0))
    pupil.begin(0)
    assert pupil.values(S0)[UP] == pytest.approx(0.625)
    assert pupil.values(S1)[LEFT] == pytest.approx(-0.75)
