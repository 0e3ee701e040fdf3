"""`guidance`: what teachers point at chooses, their reward teaches, and undo takes a step back."""

from collections import Counter

import pytest

from sfid_core.learning.kernels import Evidence, Learned
from sfid_core.learning.methods import method_named
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import merge
from tests.core.learning.pupil import DOWN, LEFT, RIGHT, S0, S1, UP, Pupil, rewards


def pointing(*actions: int) -> Evidence:
    return merge([Answer(AnswerKind.GUIDANCE, guidance=actions)], 4, 0.0)


def test_two_steps_computed_by_hand() -> None:
    """alpha 0.5, gamma 0.5; guidance changes no value.

    1. s0, UP, praise +1, r = 0, to s1:  0 + 1 + 0.5 * 0 - 0 = 1.        Q(s0, UP) = 0.5
    2. s1, LEFT, blame -1, r = 2, to s0: 2 - 1 + 0.5 * 0.5 - 0 = 1.25.   Q(s1, LEFT) = 0.625
    """
    pupil = Pupil("guidance", alpha=0.5, gamma=0.5)
    assert pupil.do(S0, UP, 0.0, rewards(1.0), S1) == Learned(0.0, 1.0, 1.0)
    assert pupil.do(S1, LEFT, 2.0, rewards(-1.0), S0) == Learned(2.25, 1.25, -1.0)
    assert (pupil.rounded(S0), pupil.rounded(S1)) == ([0, 0, 0.5, 0], [0.625, 0, 0, 0])


def test_the_best_action_that_is_pointed_at_is_taken() -> None:
    pupil = Pupil("guidance", alpha=1.0)
    for action, value in ((LEFT, 5.0), (RIGHT, 1.0), (UP, 3.0), (DOWN, -1.0)):
        pupil.do(S0, action, value)
    assert pupil.choose(S0, 0) == LEFT
    assert pupil.settle(S0, LEFT, pointing(RIGHT, UP), 0) == UP
    assert pupil.settle(S0, LEFT, pointing(DOWN), 0) == DOWN
    assert pupil.settle(S0, LEFT, Evidence(), 0) == LEFT


def test_ties_among_what_is_pointed_at_are_drawn() -> None:
    pupil = Pupil("guidance")
    taken = Counter(pupil.settle(S0, LEFT, pointing(RIGHT, DOWN), decision) for decision in range(4000))
    assert set(taken) == {RIGHT, DOWN}
    assert abs(taken[RIGHT] - 2000) < 150


@pytest.mark.parametrize(
    "mode, blamed, asked",
    [("blamed", True, True), ("asked", False, True), ("never", False, False)],
)
def test_when_a_step_is_taken_back(mode: str, blamed: bool, asked: bool) -> None:  # noqa: FBT001 - a table
    pupil = Pupil("guidance", undo=mode)
    assert pupil.undoes(merge(rewards(-1.0), 4, 0.0)) is blamed
    assert pupil.undoes(merge([Answer(AnswerKind.UNDO)], 4, 0.0)) is asked
    assert not pupil.undoes(merge(rewards(1.0), 4, 0.0))
    assert not pupil.undoes(Evidence())


def test_taking_back_is_blame_too() -> None:
    said = merge([Answer(AnswerKind.UNDO)], 4, 0.0)
    assert (said.given, said.reward, said.undo) == (1, -1.0, 1)


def test_guidance_of_several_teachers_is_what_more_than_half_point_at() -> None:
    answers = [Answer(AnswerKind.GUIDANCE, guidance=actions) for actions in ((LEFT, UP), (UP,), (UP, DOWN))]
    assert merge(answers, 4, 0.0).guidance == 1 << UP
    assert merge(answers[:2], 4, 0.0).guidance == 1 << UP


def test_it_asks_before_and_after_and_offers_to_take_back() -> None:
    method = method_named("guidance")
    assert (method.asks_before, method.asks_after, method.may_undo) == (
        AnswerKind.GUIDANCE,
        AnswerKind.REWARD,
        True,
    )
