"""Several direct teachers become one: a vote each, a tie is silence."""

import pytest

from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import merge_labels, merge_rewards

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
