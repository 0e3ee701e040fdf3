"""The three methods of the founding paper against updates computed by hand."""

from collections import Counter

import pytest

from sfid_core.learning.method import Method, ParameterError, Parameters
from sfid_core.learning.methods import METHODS, make_method
from sfid_core.learning.q_learning import TDErrors, greedy, update
from sfid_core.learning.sfid import omega
from sfid_core.teaching.answers import Answer, AnswerKind

S0, S1 = b"s0", b"s1"
LEFT, RIGHT, UP, DOWN = range(4)


def made(name: str, alpha: float = 0.1, gamma: float = 0.9) -> Method:
    return make_method(name, 4, Parameters(alpha, gamma), seed=7, session="lab")


def labels(*actions: int) -> list[Answer]:
    return [Answer(AnswerKind.LABEL, action=action) for action in actions]


def rewards(*values: float) -> list[Answer]:
    return [Answer(AnswerKind.REWARD, reward=value) for value in values]


def test_three_steps_of_sfid_computed_by_hand() -> None:
    """Paper Eq. 2 and 4 with alpha 0.1, gamma 0.9 and Q = 0 at first.

    1. s0, UP, label UP: h = +1, r = 0, to s1.
       Eq. 2: 0 + 0.9 * 0 - 0 = 0.         Eq. 4: 0 + 1 = 1.       Q(s0, UP)   = 0 + 0.1 * 1        = 0.1
    2. s1, LEFT, label DOWN: h = -1, r = -1, to s0, where max Q = 0.1.
       Eq. 2: -1 + 0.9 * 0.1 - 0 = -0.91.  Eq. 4: -0.91 - 1 = -1.91.  Q(s1, LEFT) = 0 + 0.1 * -1.91 = -0.191
    3. s0, UP, no label: h = 0, r = 10, solved: no next state.
       Eq. 2: 10 - 0.1 = 9.9.              Eq. 4: 9.9.             Q(s0, UP)   = 0.1 + 0.1 * 9.9    = 1.09
    """
    sfid = made("sfid")
    first = sfid.learn(S0, UP, 0.0, sfid.judge(UP, labels(UP)).h, S1)
    second = sfid.learn(S1, LEFT, -1.0, sfid.judge(LEFT, labels(DOWN)).h, S0)
    third = sfid.learn(S0, UP, 10.0, sfid.judge(UP, []).h, None)
    assert first == TDErrors(0.0, 1.0)
    assert second == pytest.approx((-0.91, -1.91))
    assert third == pytest.approx((9.9, 9.9))
    assert sfid.table.values(S0) == pytest.approx([0, 0, 1.09, 0])
    assert sfid.table.values(S1) == pytest.approx([-0.191, 0, 0, 0])


def test_three_steps_of_reward_shaping_computed_by_hand() -> None:
    """Algorithm 1 with alpha 0.5, gamma 0.5.

    1. s0, LEFT, praise +1, r = 0, to s1.      Eq. 4: 0 + 1 + 0.5 * 0 - 0 = 1.          Q(s0, LEFT) = 0.5
    2. s1, RIGHT, blame -0.5, r = 0, to s0.    Eq. 4: 0 - 0.5 + 0.5 * 0.5 - 0 = -0.25.  Q(s1, RIGHT) = -0.125
    3. s0, LEFT, silence, r = 1, to s1.        Eq. 4: 1 + 0.5 * 0 - 0.5 = 0.5.          Q(s0, LEFT) = 0.75
    """
    method = made("reward", 0.5, 0.5)
    method.learn(S0, LEFT, 0.0, method.judge(LEFT, rewards(1.0)).h, S1)
    second = method.learn(S1, RIGHT, 0.0, method.judge(RIGHT, rewards(-0.5)).h, S0)
    method.learn(S0, LEFT, 1.0, method.judge(LEFT, []).h, S1)
    assert second == TDErrors(0.25, -0.25)
    assert list(method.table.values(S0)) == [0.75, 0, 0, 0]
    assert list(method.table.values(S1)) == [0, -0.125, 0, 0]


def test_three_steps_of_q_learning_computed_by_hand() -> None:
    """Eq. 1 and 2 with alpha 0.5, gamma 0.5: no answer changes anything.

    1. s1, UP, r = 4, solved:    delta = 4.              Q(s1, UP)   = 2
    2. s0, DOWN, r = 0, to s1:   delta = 0.5 * 2 = 1.    Q(s0, DOWN) = 0.5
    3. s0, DOWN, r = 0, to s0:   delta = 0.5 * 0.5 - 0.5 = -0.25.  Q(s0, DOWN) = 0.375
    """
    method = made("q-learning", 0.5, 0.5)
    assert method.judge(UP, labels(UP)).h == 0.0
    assert method.learn(S1, UP, 4.0, 0.0, None) == TDErrors(4.0, 4.0)
    assert method.learn(S0, DOWN, 0.0, 0.0, S1) == TDErrors(1.0, 1.0)
    assert method.learn(S0, DOWN, 0.0, 0.0, S0) == TDErrors(-0.25, -0.25)
    assert list(method.table.values(S0)) == [0, 0, 0, 0.375]
    assert list(method.table.values(S1)) == [0, 0, 2, 0]


@pytest.mark.parametrize("label, expected", [(UP, 1.0), (DOWN, -1.0), (None, 0.0)])
def test_omega_is_agreement_disagreement_or_silence(label: int | None, expected: float) -> None:
    assert omega(label, UP) == expected


def test_what_the_three_methods_ask_for() -> None:
    assert {name: made(name).asks for name in METHODS} == {
        "sfid": AnswerKind.LABEL,
        "reward": AnswerKind.REWARD,
        "q-learning": None,
    }


def test_the_greedy_action_is_the_largest_value_whatever_is_drawn() -> None:
    assert {greedy([0.0, 2.0, -1.0, 1.9], key, counter) for key in range(10) for counter in range(10)} == {1}


def test_ties_are_drawn_evenly_among_the_largest_values_and_only_among_them() -> None:
    counts = Counter(greedy([1.0, 0.0, 1.0, 1.0], 99, counter) for counter in range(9000))
    assert set(counts) == {0, 2, 3}
    assert all(abs(count - 3000) < 300 for count in counts.values())


def test_a_choice_depends_on_the_decision_and_not_on_the_order_of_calls() -> None:
    method = made("sfid")
    forwards = [method.choose(S0, decision) for decision in range(50)]
    backwards = [method.choose(S0, decision) for decision in reversed(range(50))]
    assert forwards == backwards[::-1]
    assert set(forwards) == {0, 1, 2, 3}


def test_sessions_and_seeds_have_choices_of_their_own() -> None:
    def choices(seed: int, session: str) -> tuple[int, ...]:
        method = make_method("sfid", 4, Parameters(), seed, session)
        return tuple(method.choose(S0, decision) for decision in range(40))

    assert len({choices(1, "lab"), choices(2, "lab"), choices(1, "hall")}) == 3


def test_update_moves_one_value_by_alpha_times_the_error() -> None:
    row = [1.0, 2.0, 3.0, 4.0]
    assert update(row, 1, 5.0, -1.0, 10.0, 0.5, 0.5) == TDErrors(8.0, 7.0)
    assert row == [1.0, 5.5, 3.0, 4.0]


@pytest.mark.parametrize("alpha, gamma", [(0, 0.9), (-0.1, 0.9), (1.1, 0.9), (0.1, -0.1), (0.1, 1.0)])
def test_parameters_outside_their_ranges_are_refused_in_one_line(alpha: float, gamma: float) -> None:
    with pytest.raises(ParameterError, match=r"^(alpha|gamma) [^\n]+ is outside [^\n]+$"):
        Parameters(alpha, gamma)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_parameters_that_are_no_numbers_are_refused(value: float) -> None:
    with pytest.raises(ParameterError):
        Parameters(alpha=value)
    with pytest.raises(ParameterError):
        Parameters(gamma=value)
