"""SfID's silence, exploration and label memory against updates computed by hand."""

import pytest

from sfid_core.learning.kernels import Learned
from tests.core.learning.pupil import DOWN, LEFT, S0, S1, UP, Pupil, labels


def test_a_silent_step_counts_with_its_reward_or_not_at_all() -> None:
    """alpha 0.5: r = 4 and silence move Q(s0, UP) to 2, or leave it."""
    zero, skip = Pupil("sfid", alpha=0.5), Pupil("sfid", alpha=0.5, silence="skip")
    assert zero.do(S0, UP, 4.0) == skip.do(S0, UP, 4.0) == Learned(4.0, 4.0, 0.0)
    assert (zero.rounded(S0), skip.rounded(S0)) == ([0, 0, 2, 0], [0, 0, 0, 0])
    assert (len(zero), len(skip)) == (1, 0)


@pytest.mark.parametrize("method", ["sfid", "reward", "q-learning", "potential", "sfid-memory", "guide"])
def test_epsilon_is_the_probability_of_any_action(method: str) -> None:
    """One value above the others, epsilon 0.4: its action in 0.6 + 0.1 of the choices; without, always."""
    chosen = []
    for explore in (0.4, 0.0):
        pupil = Pupil(method, explore=explore)
        pupil.do(S0, UP, 1.0, labels(UP))
        chosen.append([pupil.choose(S0, decision) for decision in range(4000)].count(UP))
    assert chosen == [pytest.approx(2800, abs=120), 4000]


def test_one_label_teaches_the_model_about_every_action() -> None:
    """alpha 0.5, label UP, LEFT taken: H(UP) = 0.5 * 1, the others 0.5 * -1; error -1 - 0.

    Then label DOWN, UP taken: H(UP) = 0.5 + 0.5 * (-1 - 0.5) = -0.25, H(DOWN) = -0.5 + 0.5 * 1.5 = 0.25,
    the others -0.75; error -1 - 0.5. The reward of the environment is not looked at.
    """
    pupil = Pupil("sfid-memory", alpha=0.5)
    assert pupil.do(S0, LEFT, 9.0, labels(UP), S1) == Learned(-1.0, -1.0, -1.0)
    assert pupil.rounded(S0) == [-0.5, -0.5, 0.5, -0.5]
    assert pupil.do(S0, UP, 9.0, labels(DOWN), S1) == Learned(-1.5, -1.5, -1.0)
    assert pupil.rounded(S0) == [-0.75, -0.75, -0.25, 0.25]


def test_in_silence_the_model_stays_or_fades() -> None:
    for keep, expected in ((1.0, 0.5), (0.5, 0.25)):
        pupil = Pupil("sfid-memory", alpha=0.5, keep=keep)
        pupil.do(S0, UP, 0.0, labels(UP), S1)
        assert pupil.do(S0, UP, 0.0, (), S1) == Learned(0.0, 0.0, 0.0)
        assert pupil.rounded(S0) == [-expected, -expected, expected, -expected]


def test_in_silence_the_latest_label_of_the_state_rewards_whatever_is_done_there() -> None:
    """alpha 0.5, gamma 0, keep 1/2. Label UP, UP taken: h = 1, Q(UP) = 0.5.

    Silence, DOWN taken: the label said -1 of it, half is left: h = -0.5, Q(DOWN) = -0.25.
    Silence, UP taken: a quarter is left: h = 0.25, Q(UP) = 0.5 + 0.5 * (0.25 - 0.5) = 0.375.
    """
    pupil = Pupil("sfid-memory", alpha=0.5, gamma=0.0, policy="shaped", keep=0.5)
    assert pupil.do(S0, UP, 0.0, labels(UP), S1) == Learned(0.0, 1.0, 1.0)
    assert pupil.do(S0, DOWN, 0.0, (), S1) == Learned(0.0, -0.5, -0.5)
    assert pupil.do(S0, UP, 0.0, (), S1) == Learned(-0.5, -0.25, 0.25)
    assert pupil.rounded(S0) == [0, 0, 0.375, -0.25]
