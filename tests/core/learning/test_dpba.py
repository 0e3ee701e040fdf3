"""Dynamic potential-based advice against updates computed by hand."""

import pytest

from sfid_core.learning.kernels import Learned
from tests.core.learning.pupil import LEFT, S0, S1, S2, UP, Pupil, rewards


def taught(acts: str = "corrected") -> tuple[Pupil, list[Learned]]:
    """s0, UP, praise, to s1; s1, LEFT, blame, r = 4, solved. alpha = gamma = 0.5, beta = 0.25.

    Step 0 waits for step 1: F = 0, Q(s0, UP) stays 0, Phi(s0, UP) = 0.25 * (-1 + 0) = -0.25.
    Step 1 ends: Q(s1, LEFT) = 0.5 * 4 = 2, Phi(s1, LEFT) = 0.25 * (1 + 0) = 0.25.
    """
    pupil = Pupil("dpba", alpha=0.5, gamma=0.5, beta=0.25, acts=acts, explore=0.0)
    return pupil, [pupil.do(S0, UP, 0.0, rewards(1.0), S1), pupil.do(S1, LEFT, 4.0, rewards(-1.0))]


def test_a_step_is_learnt_with_the_action_that_follows_it_and_the_last_at_once() -> None:
    pupil, learned = taught()
    assert learned == [Learned(0.0, 0.0, 1.0), Learned(4.0, 4.0, -1.0)]
    assert pupil.rounded(S0) == [0, 0, -0.25, 0]
    assert pupil.rounded(S1) == [2.25, 0, 0, 0]
    assert taught("shaped")[0].rounded(S1) == [2, 0, 0, 0]
    assert taught("shaped")[0].rounded(S0) == [0, 0, 0, 0]


def test_the_potential_shapes_the_next_time() -> None:
    """s0, UP in silence, then s1, LEFT: F = 0.5 * 0.25 + 0.25 = 0.375.

    Q(s0, UP) = 0.5 * (0 + 0.375 + 0.5 * 2 - 0) = 0.6875; Phi(s0, UP) = -0.25 + 0.25 * (0 + 0.375) = -0.15625.
    """
    pupil, _ = taught()
    pupil.begin(1)
    pupil.do(S0, UP, 0.0, (), S1)
    after = pupil.do(S1, LEFT, 0.0, (), S2)
    assert after.shaped == pytest.approx(1.375)
    assert pupil.rounded(S0) == [0, 0, 0.53125, 0]
    assert {pupil.choose(S0, decision) for decision in range(50)} == {UP}


def test_a_step_that_was_cut_off_is_left_out() -> None:
    pupil = Pupil("dpba", explore=0.0)
    pupil.do(S0, UP, 5.0, rewards(1.0), S1)
    pupil.begin(1)
    pupil.do(S1, LEFT, 0.0, (), S0)
    assert pupil.rounded(S0) == [0, 0, 0, 0]
