"""Several direct teachers become one: a vote each, a tie is silence."""

import pytest

from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import merge, merge_guidance, merge_labels, merge_marks, merge_rewards

ABSTAIN = Answer(AnswerKind.ABSTAIN)


@pytest.mark.parametrize(
    "actions, merged",
    [
        ([], None),
        ([2], 2),
        ([2, 2, 1], 2),
        ([1, 2], None),
        ([1, 1, 2, 2, 3], None),
        ([0, 1, 2, 3], None),
        ([3, 0, 0], 0),
    ],
)
def test_the_action_with_the_most_votes_is_the_label(actions: list[int], merged: int | None) -> None:
    answers = [Answer(AnswerKind.LABEL, action=action) for action in actions]
    assert merge_labels(answers) == merged
    assert merge_labels(reversed(answers)) == merged
    assert merge_labels([ABSTAIN, *answers, ABSTAIN]) == merged


@pytest.mark.parametrize(
    "rewards, merged",
    [
        ([], None),
        ([0.0], None),
        ([0.25], 0.25),
        ([-1.0], -1.0),
        ([1.0, -1.0], None),
        ([1.0, 0.5, -1.0], 0.75),
        ([-1.0, 1.0, -0.5, 0.0], -0.75),
    ],
)
def test_the_side_with_more_votes_gives_its_mean_reward(rewards: list[float], merged: float | None) -> None:
    answers = [Answer(AnswerKind.REWARD, reward=reward) for reward in rewards]
    assert merge_rewards(answers) == merged
    assert merge_rewards(reversed(answers)) == merged
    assert merge_rewards([ABSTAIN, *answers]) == merged


@pytest.mark.parametrize(
    "sets, merged",
    [
        ([], 0b0000),
        ([(1, 2)], 0b0110),
        ([(1, 2), (2, 3)], 0b0100),
        ([(0,), (1,)], 0b0000),
        ([(0, 1), (1, 2), (2, 3)], 0b0110),
        ([(3, 3), (3,), (0,)], 0b1000),
    ],
)
def test_guidance_is_what_more_than_half_of_those_who_guide_point_at(
    sets: list[tuple[int, ...]], merged: int
) -> None:
    answers = [Answer(AnswerKind.GUIDANCE, guidance=actions) for actions in sets]
    assert merge_guidance(answers) == merged
    assert merge_guidance([ABSTAIN, *answers, ABSTAIN]) == merged


def test_a_step_is_taken_back_where_more_than_half_of_all_who_answered_say_so() -> None:
    undo, praise = Answer(AnswerKind.UNDO), Answer(AnswerKind.REWARD, reward=1.0)
    told = [merge(answers, 4, 0.0) for answers in ([undo, praise], [undo, undo, praise], [undo, ABSTAIN])]
    assert [(one.undo, one.reward) for one in told] == [(0, 1.0), (1, -1.0), (0, 0.0)]


def test_the_mark_that_most_teachers_made_counts_and_a_tie_is_silence() -> None:
    early, late = (Answer(AnswerKind.MISTAKE, action=1, steps=(step, 4)) for step in (2, 3))
    assert merge_marks([early, late, late]) == late
    assert merge_marks([early, late]) is None
    assert merge_marks([ABSTAIN]) is None
