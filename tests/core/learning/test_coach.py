"""COACH against gradients computed by hand."""

from collections import Counter

import pytest

from sfid_core.learning.kernels import Learned
from tests.core.learning.pupil import LEFT, S0, S1, UP, Pupil, rewards


def test_praise_moves_the_policy_along_its_gradient() -> None:
    """alpha 1, no trace. pi = 1/4 each: gradient (-1/4, -1/4, 3/4, -1/4) for UP; error 1 * (1 - 1/4)."""
    pupil = Pupil("coach", alpha=1.0, trace=0.0)
    assert pupil.do(S0, UP, 5.0, rewards(1.0), S1) == Learned(0.75, 0.75, 1.0)
    assert pupil.rounded(S0) == [-0.25, -0.25, 0.75, -0.25]
    assert pupil.rounded(S1) == [0, 0, 0, 0]


def test_the_trace_gives_earlier_steps_their_share() -> None:
    """alpha 1, lambda 1/2: UP in s0 in silence, then LEFT in s1 with blame -1.

    theta(s0, .) = -1 * 1/2 * (-1/4, -1/4, 3/4, -1/4); theta(s1, .) = -1 * (3/4, -1/4, -1/4, -1/4).
    """
    pupil = Pupil("coach", alpha=1.0, trace=0.5)
    assert pupil.do(S0, UP, 0.0, (), S1) == Learned(0.0, 0.0, 0.0)
    assert pupil.do(S1, LEFT, 0.0, rewards(-1.0), S0) == Learned(-0.75, -0.75, -1.0)
    assert pupil.rounded(S0) == [0.125, 0.125, -0.375, 0.125]
    assert pupil.rounded(S1) == [-0.75, 0.25, 0.25, 0.25]


def test_a_state_met_twice_has_one_trace() -> None:
    """alpha 1, lambda 1/2: UP twice in s0, the second praised: (1 + 1/2) times the gradient."""
    pupil = Pupil("coach", alpha=1.0, trace=0.5)
    pupil.do(S0, UP, 0.0, (), S0)
    pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    assert pupil.rounded(S0) == [-0.375, -0.375, 1.125, -0.375]


def test_feedback_is_for_the_step_so_many_steps_ago() -> None:
    pupil = Pupil("coach", alpha=1.0, trace=0.0, delay_steps=1)
    pupil.do(S0, UP, 0.0, rewards(-1.0), S1)
    pupil.do(S1, LEFT, 0.0, rewards(1.0), S0)
    assert pupil.rounded(S0) == [-0.25, -0.25, 0.75, -0.25]
    assert pupil.rounded(S1) == [0, 0, 0, 0]


def test_the_trace_ends_with_the_episode() -> None:
    pupil = Pupil("coach", alpha=1.0, trace=0.9)
    pupil.do(S0, UP, 0.0, (), S1)
    pupil.steps = 0
    pupil.begin(1)
    pupil.do(S1, LEFT, 0.0, rewards(1.0), S0)
    assert pupil.rounded(S0) == [0, 0, 0, 0]


def test_actions_are_drawn_with_the_probabilities_of_the_policy() -> None:
    """theta = (-1/4, -1/4, 3/4, -1/4): e / (e + 3) = 0.4754 for UP."""
    pupil = Pupil("coach", alpha=1.0, trace=0.0)
    pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    counts = Counter(pupil.choose(S0, decision) for decision in range(8000))
    assert counts[UP] == pytest.approx(3803, abs=180)
    assert counts[LEFT] == pytest.approx(1399, abs=140)


@pytest.mark.parametrize("trace", [0.0, 0.9])
def test_a_state_met_again_in_the_next_episode_starts_without_a_trace(trace: float) -> None:
    """alpha 1: UP in silence, then, an episode later, LEFT with praise: the gradient of LEFT alone."""
    pupil = Pupil("coach", alpha=1.0, trace=trace)
    pupil.do(S0, UP)
    pupil.begin(1)
    pupil.do(S0, LEFT, 0.0, rewards(1.0), S1)
    assert pupil.rounded(S0) == [0.75, -0.25, -0.25, -0.25]
