"""TAMER+RL against updates computed by hand, by technique."""

import pytest

from sfid_core.learning.kernels import Learned
from tests.core.learning.pupil import LEFT, S0, S1, UP, Pupil, rewards


def taught(technique: str, weight: float = 2.0) -> tuple[Pupil, list[Learned]]:
    """s0, UP, praise, to s1; s1, LEFT, r = 4, solved; s0, UP, blame, to s1. All step sizes and gamma 0.5.

    H(s0, UP) = 0.5 * 1 = 0.5, then 0.5 + 0.5 * (-1 - 0.5) = -0.25.
    """
    pupil = Pupil(
        "tamer-rl",
        alpha=0.5,
        gamma=0.5,
        model_alpha=0.5,
        technique=technique,
        weight=weight,
        anneal=0.5,
        explore=0.0,
    )
    learned = [
        pupil.do(S0, UP, 0.0, rewards(1.0), S1),
        pupil.do(S1, LEFT, 4.0),
        pupil.do(S0, UP, 0.0, rewards(-1.0), S1),
    ]
    return pupil, learned


@pytest.mark.parametrize("technique", ["action-biasing", "control-sharing"])
def test_q_learns_from_the_environment_alone_where_the_teacher_only_steers(technique: str) -> None:
    """Q(s1, LEFT) = 0.5 * 4 = 2; Q(s0, UP) = 0.5 * (0 + 0.5 * 2 - 0) = 0.5."""
    _, learned = taught(technique)
    assert learned == [Learned(0.0, 0.0, 1.0), Learned(4.0, 4.0, 0.0), Learned(1.0, 1.0, -1.0)]


def test_action_biasing_adds_the_annealed_model_to_the_values() -> None:
    """Q + 2 * H at s0: 0.5 + 2 * -0.25 = 0; one episode later 0.5 + 1 * -0.25 = 0.25; then 0.5 - 0.125."""
    pupil, _ = taught("action-biasing")
    assert pupil.rounded(S0) == [0, 0, 0, 0]
    pupil.begin(1)
    assert pupil.rounded(S0) == [0, 0, 0.25, 0]
    pupil.begin(2)
    assert pupil.rounded(S0) == [0, 0, 0.375, 0]
    assert pupil.rounded(S1) == [2, 0, 0, 0]
    assert {pupil.choose(S0, decision) for decision in range(50)} == {UP}


def test_control_sharing_hands_the_wheel_to_the_model_with_the_probability_of_its_weight() -> None:
    """argmax Q(s0, .) is UP, argmax H(s0, .) any other; the weight is 0.25: UP with 3/4, else 1/12 each."""
    pupil, _ = taught("control-sharing", weight=0.25)
    assert pupil.rounded(S0) == pytest.approx([1 / 12, 1 / 12, 3 / 4, 1 / 12], abs=1e-9)
    chosen = [pupil.choose(S0, decision) for decision in range(4000)]
    assert chosen.count(UP) == pytest.approx(3000, abs=150)
    assert chosen.count(LEFT) == pytest.approx(333, abs=80)


def test_control_sharing_without_the_teacher_may_be_the_policy_of_whoever_is_in_control() -> None:
    """Q(s0, .) = (0, 0, 1/2, 0), H(s0, .) = (0, 0, -1/4, 0), B = 1, 1/2, 1/4: probabilities, then Q."""
    pupil = Pupil(
        "tamer-rl", technique="control-sharing", weight=1.0, anneal=0.5, explore=0.0, alone="in-control"
    )
    pupil.values(S0)
    pupil.memory.values[2], pupil.memory.values[6] = 0.5, -0.25
    found = []
    for episode in range(3):
        pupil.begin(episode)
        found.append(pupil.values(S0))
    assert found[0] == pytest.approx([1 / 3, 1 / 3, 0, 1 / 3])
    assert found[1] == pytest.approx([1 / 6, 1 / 6, 1 / 2, 1 / 6])
    assert found[2] == (0, 0, 0.5, 0)


def test_reward_shaping_adds_the_weighed_model_to_the_reward() -> None:
    """1. Eq. 4: 0 + 2 * 0.5 + 0.5 * 0 - 0 = 1.  Q(s0, UP) = 0.5
    2. 4 + 2 * 0 - 0 = 4.  Q(s1, LEFT) = 2
    3. Eq. 2: 0 + 0.5 * 2 - 0.5 = 0.5.  Eq. 4: 0.5 + 2 * -0.25 = 0.  Q(s0, UP) stays 0.5
    """
    pupil, learned = taught("reward-shaping")
    assert learned == [Learned(0.0, 1.0, 1.0), Learned(4.0, 4.0, 0.0), Learned(0.5, 0.0, -1.0)]
    assert (pupil.rounded(S0), pupil.rounded(S1)) == ([0, 0, 0.5, 0], [2, 0, 0, 0])


def test_q_augmentation_bootstraps_from_the_sum_of_both() -> None:
    """1. 0 + 0.5 * 0 - (0 + 2 * 0.5) = -1.  Q(s0, UP) = -0.5
    2. 4 - 0 = 4.  Q(s1, LEFT) = 2
    3. Eq. 2: 0 + 0.5 * 2 + 0.5 = 1.5.  Sum: 0.5 * 2 - (-0.5 + 2 * -0.25) = 2.  Q(s0, UP) = -0.5 + 1 = 0.5
    Shown: Q + 2 * H.
    """
    pupil, learned = taught("q-augmentation")
    assert learned == [Learned(0.0, -1.0, 1.0), Learned(4.0, 4.0, 0.0), Learned(1.5, 2.0, -1.0)]
    assert (pupil.rounded(S0), pupil.rounded(S1)) == ([0, 0, 0, 0], [2, 0, 0, 0])


def test_epsilon_is_the_probability_of_any_action_beside_the_techniques() -> None:
    """UP leads in every technique but control sharing's model; epsilon 0.4: 0.6 + 0.1 of the choices."""
    for technique in ("action-biasing", "control-sharing", "q-augmentation", "reward-shaping"):
        pupil = Pupil("tamer-rl", technique=technique, explore=0.4)
        pupil.do(S0, UP, 1.0, rewards(1.0))
        chosen = [pupil.choose(S0, decision) for decision in range(4000)]
        assert chosen.count(UP) == pytest.approx(2800, abs=120)


@pytest.mark.parametrize("praised", [LEFT, UP])
def test_q_augmentation_looks_ahead_to_the_weighed_model_of_every_action(praised: int) -> None:
    """All step sizes and gamma 0.5, weight 2. s1, praise, the end: H = 0.5, Q = 0.5 * (0 - 2 * 0.5) = -0.5.

    s0, UP, silence, to s1: 0.5 * (-0.5 + 2 * 0.5) = 0.25; Eq. 2 looks at Q alone: 0.5 * 0 = 0.
    """
    pupil = Pupil(
        "tamer-rl", alpha=0.5, gamma=0.5, model_alpha=0.5, technique="q-augmentation", weight=2.0, anneal=0.5
    )
    pupil.do(S1, praised, 0.0, rewards(1.0))
    assert pupil.do(S0, UP, 0.0, (), S1) == Learned(0.0, 0.25, 0.0)


def test_eligibility_lets_the_model_count_where_answers_are_recent() -> None:
    """c = 0.4, decay 1/2 a step; H(s0, UP) = 1/2 after one praise, B = 2.

    e(s0, UP) = 0.4, then 0.2 after a silent step elsewhere: Q + B e H = 0.2 * 2 * 0.5 = 0.2. A second praise:
    e = 0.1 + 0.4 = 0.5, H = 0.75: 0.75. It falls by steps, not by episodes.
    """
    pupil = Pupil(
        "tamer-rl", influence="eligibility", eligibility_gain=0.4, eligibility_decay=0.5, weight=2.0,
        anneal=0.1, model_alpha=0.5, explore=0.0,
    )  # fmt: skip
    pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    assert pupil.rounded(S0) == [0, 0, 0.4, 0]
    pupil.do(S1, LEFT, 0.0, (), S0)
    pupil.begin(1)
    assert pupil.rounded(S0) == [0, 0, 0.2, 0]
    pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    assert pupil.rounded(S0) == [0, 0, 0.75, 0]
    assert {pupil.choose(S0, decision) for decision in range(50)} == {UP}
    for _ in range(4):
        pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    assert pupil.values(S0)[UP] <= 2.0


def test_eligibility_shares_control_by_the_state_s_largest_weight() -> None:
    """B = 1, e(s0, UP) = 0.2: the model is in control of s0 with 0.2, UP then; else any action, 0.2 each."""
    pupil = Pupil(
        "tamer-rl", technique="control-sharing", influence="eligibility", eligibility_gain=0.2,
        weight=1.0, explore=0.0,
    )  # fmt: skip
    pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    assert pupil.rounded(S0) == pytest.approx([0.2, 0.2, 0.4, 0.2])
    chosen = [pupil.choose(S0, decision) for decision in range(4000)]
    assert chosen.count(UP) == pytest.approx(1600, abs=120)
