"""The three methods of the founding paper against updates computed by hand."""

from collections import Counter

import pytest

from sfid_core.learning.kernels import Learned
from sfid_core.learning.learner import learner_draws
from sfid_core.learning.methods import method_named, method_parameters
from sfid_core.learning.parameters import ParameterError
from sfid_core.learning.sfid import omega
from sfid_core.teaching.answers import Answer, AnswerKind
from tests.core.learning.pupil import DOWN, LEFT, RIGHT, S0, S1, UP, Pupil, labels, rewards


def test_three_steps_of_sfid_computed_by_hand() -> None:
    """Paper Eq. 2 and 4 with alpha 0.1, gamma 0.9 and Q = 0 at first.

    1. s0, UP, label UP: h = +1, r = 0, to s1.
       Eq. 2: 0 + 0.9 * 0 - 0 = 0.         Eq. 4: 0 + 1 = 1.       Q(s0, UP)   = 0 + 0.1 * 1        = 0.1
    2. s1, LEFT, label DOWN: h = -1, r = -1, to s0, where max Q = 0.1.
       Eq. 2: -1 + 0.9 * 0.1 - 0 = -0.91.  Eq. 4: -0.91 - 1 = -1.91.  Q(s1, LEFT) = 0 + 0.1 * -1.91 = -0.191
    3. s0, UP, no label: h = 0, r = 10, solved: no next state.
       Eq. 2: 10 - 0.1 = 9.9.              Eq. 4: 9.9.             Q(s0, UP)   = 0.1 + 0.1 * 9.9    = 1.09
    """
    sfid = Pupil("sfid")
    first = sfid.do(S0, UP, 0.0, labels(UP), S1)
    second = sfid.do(S1, LEFT, -1.0, labels(DOWN), S0)
    third = sfid.do(S0, UP, 10.0)
    assert first == Learned(0.0, 1.0, 1.0)
    assert second == pytest.approx((-0.91, -1.91, -1.0))
    assert third == pytest.approx((9.9, 9.9, 0.0))
    assert sfid.rounded(S0) == [0, 0, 1.09, 0]
    assert sfid.rounded(S1) == [-0.191, 0, 0, 0]


def test_three_steps_of_reward_shaping_computed_by_hand() -> None:
    """Algorithm 1 with alpha 0.5, gamma 0.5.

    1. s0, LEFT, praise +1, r = 0, to s1.      Eq. 4: 0 + 1 + 0.5 * 0 - 0 = 1.          Q(s0, LEFT) = 0.5
    2. s1, RIGHT, blame -0.5, r = 0, to s0.    Eq. 4: 0 - 0.5 + 0.5 * 0.5 - 0 = -0.25.  Q(s1, RIGHT) = -0.125
    3. s0, LEFT, silence, r = 1, to s1.        Eq. 4: 1 + 0.5 * 0 - 0.5 = 0.5.          Q(s0, LEFT) = 0.75
    """
    pupil = Pupil("reward", alpha=0.5, gamma=0.5)
    pupil.do(S0, LEFT, 0.0, rewards(1.0), S1)
    second = pupil.do(S1, RIGHT, 0.0, rewards(-0.5), S0)
    pupil.do(S0, LEFT, 1.0, (), S1)
    assert second == Learned(0.25, -0.25, -0.5)
    assert pupil.rounded(S0) == [0.75, 0, 0, 0]
    assert pupil.rounded(S1) == [0, -0.125, 0, 0]


def test_three_steps_of_q_learning_computed_by_hand() -> None:
    """Eq. 1 and 2 with alpha 0.5, gamma 0.5: no answer changes anything.

    1. s1, UP, r = 4, solved:    delta = 4.              Q(s1, UP)   = 2
    2. s0, DOWN, r = 0, to s1:   delta = 0.5 * 2 = 1.    Q(s0, DOWN) = 0.5
    3. s0, DOWN, r = 0, to s0:   delta = 0.5 * 0.5 - 0.5 = -0.25.  Q(s0, DOWN) = 0.375
    """
    pupil = Pupil("q-learning", alpha=0.5, gamma=0.5)
    assert pupil.do(S1, UP, 4.0, labels(UP)) == Learned(4.0, 4.0, 0.0)
    assert pupil.do(S0, DOWN, 0.0, (), S1) == Learned(1.0, 1.0, 0.0)
    assert pupil.do(S0, DOWN, 0.0, (), S0) == Learned(-0.25, -0.25, 0.0)
    assert pupil.rounded(S0) == [0, 0, 0, 0.375]
    assert pupil.rounded(S1) == [0, 0, 2, 0]


@pytest.mark.parametrize(
    "form, belief, expected",
    [
        ("graded", 1.0, 1.0),
        ("graded", 0.0, -1.0),
        ("graded", 0.7, 0.4),
        ("centred", 1.0, 1.0),
        ("centred", 0.25, 0.0),
        ("centred", 0.0, -1 / 3),
        ("penalty", 1.0, 0.0),
        ("penalty", 0.0, -1.0),
    ],
)
def test_omega_grades_the_belief_that_an_action_is_the_teachers(
    form: str, belief: float, expected: float
) -> None:
    """Four actions: 2 q - 1; (4 q - 1) / 3; q - 1."""
    number = method_parameters("sfid", {"omega": form}).omega
    assert omega(number, belief, 4) == pytest.approx(expected)


def test_a_posterior_grades_the_agreement() -> None:
    """q = (0.2, 0.6, 0.2, 0), the agent goes RIGHT: h = 2 * 0.6 - 1 = 0.2."""
    answer = Answer(AnswerKind.LABEL, action=RIGHT, posterior=(0.2, 0.6, 0.2, 0.0))
    assert Pupil("sfid").do(S0, RIGHT, 0.0, [answer], S1).h == pytest.approx(0.2)


def test_what_the_three_methods_ask_for_and_when() -> None:
    asked = {name: method_named(name) for name in ("sfid", "reward", "q-learning")}
    assert {name: (method.asks_before, method.asks_after) for name, method in asked.items()} == {
        "sfid": (AnswerKind.LABEL, None),
        "reward": (None, AnswerKind.REWARD),
        "q-learning": (None, None),
    }


def valued(*values: float) -> Pupil:
    """Return a pupil whose row of S0 holds these values."""
    pupil = Pupil("q-learning", alpha=1.0)
    for action, value in enumerate(values):
        pupil.do(S0, action, value)
    return pupil


def test_the_greedy_action_is_the_largest_value_whatever_is_drawn() -> None:
    pupil = valued(0.0, 2.0, -1.0, 1.9)
    assert {pupil.choose(S0, decision) for decision in range(100)} == {1}


def test_ties_are_drawn_evenly_among_the_largest_values_and_only_among_them() -> None:
    pupil = valued(1.0, 0.0, 1.0, 1.0)
    counts = Counter(pupil.choose(S0, decision) for decision in range(9000))
    assert set(counts) == {0, 2, 3}
    assert all(abs(count - 3000) < 300 for count in counts.values())


def test_a_choice_depends_on_the_decision_and_not_on_the_order_of_calls() -> None:
    pupil = Pupil("sfid")
    forwards = [pupil.choose(S0, decision) for decision in range(50)]
    backwards = [pupil.choose(S0, decision) for decision in reversed(range(50))]
    assert forwards == backwards[::-1]
    assert set(forwards) == {0, 1, 2, 3}


def test_sessions_and_seeds_have_choices_of_their_own() -> None:
    def choices(seed: int, session: str) -> tuple[int, ...]:
        pupil = Pupil("sfid", learner_draws(seed, session))
        return tuple(pupil.choose(S0, decision) for decision in range(40))

    assert len({choices(1, "lab"), choices(2, "lab"), choices(1, "hall")}) == 3


@pytest.mark.parametrize(
    "name, value",
    [
        ("alpha", 0.0),
        ("alpha", -0.1),
        ("alpha", 1.1),
        ("alpha", float("nan")),
        ("gamma", -0.1),
        ("gamma", 1.0),
        ("gamma", float("inf")),
    ],
)
def test_a_parameter_outside_its_range_is_refused_in_one_line(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=rf"^{name} [^\n]+ is outside [^\n]+ default is [^\n]+$"):
        method_parameters("sfid", {name: value})


def test_a_parameter_that_is_a_word_is_refused_as_no_number() -> None:
    with pytest.raises(ParameterError) as caught:
        method_parameters("sfid", {"alpha": "x"})
    assert str(caught.value) == (
        "alpha 'x' is no number: give one in (0, 1]; the default is 0.1 (Raza, Johnston & Williams 2016)"
    )


def test_an_unknown_parameter_or_word_is_refused_with_what_there_is() -> None:
    with pytest.raises(ParameterError, match=r"^method sfid has no parameter 'beta': it has alpha, gamma, "):
        method_parameters("sfid", {"beta": 1.0})
    with pytest.raises(ParameterError, match=r"^omega 'harsh' is unknown: choose one of graded, centred, "):
        method_parameters("sfid", {"omega": "harsh"})
    with pytest.raises(ParameterError, match=r"^unknown method 'magic': choose one of [^\n]*sfid"):
        method_named("magic")
