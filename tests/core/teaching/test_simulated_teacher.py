"""The simulated teacher: what it knows, how often it errs and is silent, and that it repeats itself."""

from collections import Counter

import pytest

from sfid_core.learning.parameters import ParameterError, Value, parameters_of
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.simulated import SimulatedTeacher

DECISIONS = range(20_000)
STATE = bytes(range(16))


def teacher(
    error: float = 0.0, silence: float = 0.0, name: str = "ann", seed: int = 1, actions: int = 4
) -> SimulatedTeacher:
    rates: dict[str, Value] = {"label_error": error, "reward_error": error, "silence": silence}
    return SimulatedTeacher(seed, name, "lab", parameters_of(TeacherParameters, rates, "teacher"), actions)


def share(matches: list[bool]) -> float:
    return sum(matches) / len(matches)


def test_an_expert_names_the_optimal_action_and_praises_it_alone() -> None:
    expert = teacher()
    assert {expert.label(decision, STATE, (2,)) for decision in range(100)} == {2}
    assert {expert.reward(decision, STATE, 2, (2, 3)) for decision in range(100)} == {1.0}
    assert {expert.reward(decision, STATE, 0, (2, 3)) for decision in range(100)} == {-1.0}


def test_of_several_optimal_actions_a_teacher_names_the_same_one_in_the_same_state() -> None:
    expert = teacher()
    for number in range(50):
        state = number.to_bytes(16, "big")
        named = {
            expert.label(decision, state, optimal) for decision in range(20) for optimal in ((1, 3), (3, 1))
        }
        assert len(named) == 1


def test_the_named_one_of_several_optimal_actions_differs_between_states_and_teachers() -> None:
    states = [number.to_bytes(16, "big") for number in range(3000)]
    ann = [teacher(name="ann").label(0, state, (0, 1, 3)) for state in states]
    bob = [teacher(name="bob").label(0, state, (0, 1, 3)) for state in states]
    assert all(abs(count - 1000) < 150 for count in Counter(ann).values())
    assert abs(share([one == other for one, other in zip(ann, bob, strict=True)]) - 1 / 3) < 0.05


def test_an_error_names_each_action_that_is_not_optimal_equally_often() -> None:
    erring = teacher(error=1.0)
    named = Counter(erring.label(decision, STATE, (1,)) for decision in DECISIONS)
    assert set(named) == {0, 2, 3}
    assert all(abs(count - 20_000 / 3) < 400 for count in named.values())
    assert {erring.label(decision, STATE, (1, 2)) for decision in DECISIONS} == {0, 3}


def test_an_error_where_every_action_is_optimal_names_one_that_the_teacher_would_not_name() -> None:
    named = teacher().label(0, STATE, (0, 1, 2, 3))
    wrong = {teacher(error=1.0).label(decision, STATE, (0, 1, 2, 3)) for decision in DECISIONS}
    assert wrong == {0, 1, 2, 3} - {named}
    assert teacher(error=1.0, actions=1).label(0, STATE, (0,)) is None


def test_errors_and_silence_come_at_their_rates_and_silence_is_drawn_first() -> None:
    noisy = teacher(error=0.2, silence=0.3)
    labels = [noisy.label(decision, STATE, (2,)) for decision in DECISIONS]
    assert share([label is None for label in labels]) == pytest.approx(0.3, abs=0.01)
    assert share([label != 2 for label in labels if label is not None]) == pytest.approx(0.2, abs=0.01)
    rewards = [noisy.reward(decision, STATE, 2, (2,)) for decision in DECISIONS]
    assert share([reward is None for reward in rewards]) == pytest.approx(0.3, abs=0.01)
    assert share([reward == -1.0 for reward in rewards if reward is not None]) == pytest.approx(0.2, abs=0.01)


def test_rates_of_one_always_happen_and_rates_of_zero_never() -> None:
    assert all(teacher(silence=1.0).label(decision, STATE, (0,)) is None for decision in range(1000))
    assert all(teacher(error=1.0).reward(decision, STATE, 0, (0,)) == -1.0 for decision in range(1000))


def test_a_teacher_says_the_same_whatever_was_asked_before() -> None:
    one, other = teacher(0.3, 0.3), teacher(0.3, 0.3)
    forwards = [one.label(decision, STATE, (0, 1)) for decision in range(200)]
    backwards = [other.label(decision, STATE, (0, 1)) for decision in reversed(range(200))]
    assert forwards == backwards[::-1]


def test_teachers_seeds_and_sessions_err_at_different_decisions() -> None:
    def errs(each: SimulatedTeacher) -> tuple[int | None, ...]:
        return tuple(each.label(decision, STATE, (0,)) for decision in range(100))

    ones = {
        errs(teacher(0.5)),
        errs(teacher(0.5, name="bob")),
        errs(teacher(0.5, seed=2)),
        errs(SimulatedTeacher(1, "ann", "hall", TeacherParameters(0.5, 0.5))),
    }
    assert len(ones) == 4


def test_silence_and_error_are_drawn_apart() -> None:
    """With one stream for both, the errors of a teacher would cluster at one end of its silence."""
    silent = [teacher(silence=0.5).label(decision, STATE, (0,)) is None for decision in DECISIONS]
    wrong = [teacher(error=0.5).label(decision, STATE, (0,)) != 0 for decision in DECISIONS]
    assert share([a and b for a, b in zip(silent, wrong, strict=True)]) == pytest.approx(0.25, abs=0.015)


def test_nothing_is_said_of_a_state_without_an_optimal_action() -> None:
    assert teacher(error=1.0).label(0, STATE, ()) is None
    assert teacher(error=1.0).reward(0, STATE, 1, ()) is None


@pytest.mark.parametrize("rate", [-0.1, 1.1, float("nan"), float("inf")])
def test_a_rate_outside_its_range_is_refused_in_one_line(rate: float) -> None:
    with pytest.raises(ParameterError, match=r"^label_error [^\n]+$"):
        teacher(error=rate)
    with pytest.raises(ParameterError, match=r"^silence [^\n]+$"):
        teacher(silence=rate)


def test_a_world_without_actions_is_refused() -> None:
    with pytest.raises(ParameterError, match="actions 0 is below 1"):
        teacher(actions=0)


def test_a_teacher_who_points_wrongly_judges_what_comes_of_it_by_other_draws() -> None:
    rates: dict[str, Value] = {"label_error": 0.5, "reward_error": 0.5, "silence": 0.5, "guidance_width": 1}
    guide = SimulatedTeacher(1, "ann", "lab", parameters_of(TeacherParameters, rates, "teacher"))
    pointed = [guide.guidance(decision, STATE, (2,)) for decision in DECISIONS]
    judged = [guide.reward(decision, STATE, 2, (2,)) for decision in DECISIONS]
    for said in ((2,), ()):
        after = [reward for before, reward in zip(pointed, judged, strict=True) if before == said]
        assert share([reward is None for reward in after]) == pytest.approx(0.5, abs=0.02)
        heard = [reward for reward in after if reward is not None]
        assert share([reward == 1.0 for reward in heard]) == pytest.approx(0.5, abs=0.03)
    assert share([before == () for before in pointed]) == pytest.approx(0.5, abs=0.01)
    assert share([before == (2,) for before in pointed if before]) == pytest.approx(0.5, abs=0.02)
