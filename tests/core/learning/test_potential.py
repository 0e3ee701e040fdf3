"""Potential-based shaping against updates computed by hand."""

import pytest

from sfid_core.learning.kernels import Learned
from tests.core.learning.pupil import LEFT, RIGHT, S0, S1, S2, UP, Pupil, labels


def test_shaping_by_the_optimal_value_computed_by_hand() -> None:
    """alpha 0.5, gamma 0.5, goal reward 10: Phi(d) = 10 * 0.5**(d - 1), so Phi(1, 2, 3) = 10, 5, 2.5.

    1. s0 (d 2), RIGHT, r = 0, to s1 (d 1):   Eq. 2: 0.   F = 0.5 * 10 - 5 = 0.        Q stays 0.
    2. s0 (d 2), LEFT, r = 0, to s2 (d 3):    Eq. 2: 0.   F = 0.5 * 2.5 - 5 = -3.75.   Q(s0, LEFT) = -1.875
    3. s1 (d 1), UP, r = 10, solved:          Eq. 2: 10.  F = 0 - 10.                  Q stays 0.
    4. s1 (d 1), LEFT, r = -2, dead:          Eq. 2: -2.  F = 0 - 10.                  Q(s1, LEFT) = -6
    """
    pupil = Pupil("potential", alpha=0.5, gamma=0.5, scale=1.0)
    assert pupil.do(S0, RIGHT, 0.0, (), S1, distances=(2, 1)) == Learned(0.0, 0.0, 0.0)
    assert pupil.do(S0, LEFT, 0.0, (), S2, distances=(2, 3)) == Learned(0.0, -3.75, 0.0)
    assert pupil.do(S1, UP, 10.0, distances=(1, 0)) == Learned(10.0, 0.0, 0.0)
    assert pupil.do(S1, LEFT, -2.0, distances=(1, -1)) == Learned(-2.0, -12.0, 0.0)
    assert pupil.rounded(S0) == [-1.875, 0, 0, 0]
    assert pupil.rounded(S1) == [-6, 0, 0, 0]


def test_the_scale_multiplies_the_potential_and_the_distance_is_another_form() -> None:
    """gamma 0.5, d 2 to d 1. Twice the value: 0.5 * 20 - 10 = 0; -3 d: 0.5 * -3 + 6 = 4.5."""
    twice = Pupil("potential", gamma=0.5, scale=2.0)
    thrice = Pupil("potential", gamma=0.5, scale=3.0, form="distance")
    assert twice.do(S0, RIGHT, 0.0, (), S1, distances=(2, 1)).shaped == 0.0
    assert thrice.do(S0, RIGHT, 0.0, (), S1, distances=(2, 1)).shaped == 4.5


@pytest.mark.parametrize("distances", [(-1, -1), (2, -1), (-1, 2)])
def test_without_a_known_distance_there_is_no_shaping(distances: tuple[int, int]) -> None:
    pupil = Pupil("potential", alpha=0.5)
    assert pupil.do(S0, UP, 1.0, labels(UP), S1, distances=distances) == Learned(1.0, 1.0, 0.0)
