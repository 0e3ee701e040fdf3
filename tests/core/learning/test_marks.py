"""`marks`: blame is shared among the marked steps, the correction is credited, and influence is bounded."""

from sfid_core.learning.kernels import Learned
from sfid_core.teaching.answers import Answer, AnswerKind
from tests.core.learning.pupil import DOWN, LEFT, RIGHT, S0, S1, S2, UP, Pupil


def mark(first: int, last: int, action: int | None = None) -> list[Answer]:
    return [Answer(AnswerKind.MISTAKE, action=action, steps=(first, last))]


def test_three_steps_and_a_mark_over_two_computed_by_hand() -> None:
    """alpha 0.5, gamma 0.9, no reward of the environment, Q = 0.

    Steps 0 (s0, UP), 1 (s1, LEFT), 2 (s2, DOWN), all with delta 0. After step 2 the teacher marks steps 1 to
    2 and says RIGHT: -1/2 each to Q(s1, LEFT) and Q(s2, DOWN), +1 to Q(s1, RIGHT), times alpha.
    """
    pupil = Pupil("marks", alpha=0.5)
    assert pupil.do(S0, UP, 0.0, (), S1) == Learned(0.0, 0.0, 0.0)
    assert pupil.do(S1, LEFT, 0.0, (), S2) == Learned(0.0, 0.0, 0.0)
    assert pupil.do(S2, DOWN, 0.0, mark(1, 2, RIGHT), S0) == Learned(0.0, -0.5, -0.5)
    assert pupil.rounded(S0) == [0, 0, 0, 0]
    assert pupil.rounded(S1) == [-0.25, 0.5, 0, 0]
    assert pupil.rounded(S2) == [0, 0, 0, -0.25]


def test_the_environments_reward_is_learnt_beside_the_mark() -> None:
    """delta = 2, then -1 for the only step: Q = 0.5 * 2 - 0.5 * 1."""
    pupil = Pupil("marks", alpha=0.5)
    assert pupil.do(S0, UP, 2.0, mark(0, 0)) == Learned(2.0, 1.0, -1.0)
    assert pupil.rounded(S0) == [0, 0, 0.5, 0]


def test_a_mark_of_an_earlier_step_leaves_the_latest_alone() -> None:
    pupil = Pupil("marks", alpha=0.5)
    pupil.do(S0, UP, 0.0, (), S1)
    assert pupil.do(S1, LEFT, 0.0, mark(0, 0), S2) == Learned(0.0, 0.0, 0.0)
    assert (pupil.rounded(S0), pupil.rounded(S1)) == ([0, 0, -0.5, 0], [0, 0, 0, 0])


def test_steps_that_were_not_taken_cannot_be_marked() -> None:
    pupil = Pupil("marks", alpha=0.5)
    pupil.do(S0, UP, 0.0, mark(3, 9, LEFT), S1)
    pupil.do(S1, LEFT, 0.0, mark(1, 30), S2)
    assert pupil.rounded(S0) == [0, 0, 0, 0]
    assert pupil.rounded(S1) == [-0.5, 0, 0, 0]


def test_a_mark_that_ends_before_it_begins_says_nothing() -> None:
    pupil = Pupil("marks")
    pupil.do(S0, UP, 0.0, (), S1)
    assert pupil.do(S1, LEFT, 0.0, mark(1, 0, UP), S2).h == 0.0
    assert pupil.rounded(S1) == [0, 0, 0, 0]


def test_the_influence_of_marks_on_one_action_is_bounded_either_way() -> None:
    pupil = Pupil("marks", alpha=0.5, influence=1.5)
    for _ in range(4):
        pupil.do(S0, UP, 0.0, mark(0, 0, DOWN))
    bounded = pupil.rounded(S0)
    assert bounded[DOWN] == 0.75
    pupil.do(S0, UP, 0.0, mark(0, 0, DOWN))
    assert pupil.rounded(S0)[DOWN] == 0.75


def test_what_happened_in_an_earlier_episode_is_not_marked() -> None:
    pupil = Pupil("marks", alpha=0.5)
    pupil.do(S0, UP, 0.0, (), S1)
    pupil.do(S1, LEFT, 0.0)
    pupil.begin(1)
    pupil.do(S2, DOWN, 0.0, mark(0, 1), S0)
    assert (pupil.rounded(S0), pupil.rounded(S1)) == ([0, 0, 0, 0], [0, 0, 0, 0])
    assert pupil.rounded(S2) == [0, 0, 0, -0.5]
