"""Methods by teachers: the pattern that the table shows, and the sentences about it."""

from dataclasses import replace

import numpy as np
import pytest

from sfid_core.experiments.intervals import Floats, Resampling
from sfid_core.experiments.learners import (
    CHECKPOINTS,
    DEADLOCK_REWARD,
    ORDERINGS,
    STEPS_MAX,
    TEACHERS,
    VARIANTS,
    arm,
    claims,
    conditions,
)
from sfid_core.experiments.summary import Arm
from sfid_core.learning.parameters import ParameterError
from sfid_core.session.config import WorldSpec
from sfid_core.sokoban.levels import packaged

WORLD = WorldSpec(
    packaged("room")[0].to_xsb(), "room", "all", deadlock_reward=DEADLOCK_REWARD, steps_max=STEPS_MAX
)
SEEDS = range(8)
SEEDS_BEFORE = 6


def successes(method: str, teacher: str, episodes: int) -> Floats:
    """Return the greedy success of each seed after so many episodes."""
    (full,) = conditions(WORLD, [method], [teacher])
    condition = replace(full, config=replace(full.config, episodes=episodes), checkpoints=(episodes,))
    return arm(condition, condition.run(condition.batch(fast=False), SEEDS)).totals[f"success_{episodes}"]


def success(method: str, teacher: str, episodes: int) -> float:
    return float(successes(method, teacher, episodes).mean())


@pytest.mark.parametrize(
    "method,teacher,episodes,expected",
    [
        ("sfid", "oracle", 30, 0.65),
        ("sfid", "oracle", 300, 0.97),
        ("sfid", "very-noisy", 100, 0.67),
        ("sfid", "punishment-focused", 100, 0.86),
        ("q-learning", "oracle", 30, 0.05),
        ("q-learning", "oracle", 300, 0.80),
        ("tamer", "very-noisy", 100, 0.50),
        ("coach", "oracle", 30, 0.78),
        ("dagger", "very-noisy", 30, 0.46),
        ("clone", "oracle", 300, 0.58),
        ("sabl", "punishment-focused", 30, 0.42),
        ("guide-judged", "very-noisy", 100, 0.63),
        ("guide-judged", "punishment-focused", 30, 0.29),
        ("control-sharing-switched", "very-noisy", 100, 0.34),
        ("isabl-held", "very-noisy", 30, 0.06),
        ("pies", "oracle", 100, 0.59),
    ],
)
def test_the_table_that_was_obtained_before_comes_out_within_sampling_error(
    method: str, teacher: str, episodes: int, expected: float
) -> None:
    """Three standard errors of a difference of means; the seeds before are taken to have spread like ours."""
    found = successes(method, teacher, episodes)
    error = found.std(ddof=1) * np.sqrt(1 / len(SEEDS) + 1 / SEEDS_BEFORE)
    assert found.mean() == pytest.approx(expected, abs=max(3 * error, 0.05))


def test_labels_are_robust_to_a_teacher_who_only_praises_and_reward_shaping_is_not() -> None:
    assert success("sfid", "reward-focused", 100) > 0.8
    assert success("reward", "reward-focused", 100) < 0.3


def test_every_ordering_of_the_full_table_becomes_a_claim_in_words() -> None:
    rng = np.random.default_rng(1)
    arms = [
        Arm(method, teacher, {}, {f"success_{at}": rng.random(10) for at in CHECKPOINTS})
        for method in VARIANTS
        for teacher in TEACHERS
    ]
    found = claims(arms, Resampling())
    assert len(found) == len(ORDERINGS)
    assert found[0].claim == "with the teacher oracle, coach has more success after 30 episodes than sfid"
    assert not [one.claim for one in found if "success_" in one.claim or "episodes0" in one.claim]
    assert {one.level for one in found} == {1 - 0.05 / len(ORDERINGS)}


def test_orderings_of_arms_that_were_not_run_are_left_out() -> None:
    assert claims([], Resampling()) == ()


def test_an_unknown_method_is_refused_with_the_names() -> None:
    with pytest.raises(ParameterError, match="unknown method 'foo': choose from q-learning, potential"):
        conditions(WORLD, ["foo"])
