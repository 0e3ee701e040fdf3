"""I-SABL against sums computed by hand, and against expectation maximisation without short cuts."""

import math
from random import Random

import pytest

from tests.core.learning.pupil import LEFT, S0, S1, S2, UP, Pupil, rewards

MU = (0.02, 0.2, 0.4, 0.6, 0.8)
EPS = 0.2


def silence(plus: float, minus: float) -> tuple[float, float]:
    """Return p(0 | right) and p(0 | wrong)."""
    return (1 - EPS) * plus + EPS * minus, EPS * plus + (1 - EPS) * minus


def worth(praised: int, blamed: int, right: int, wrong: int) -> float:
    """Return the expected log-ratio of silence, by products instead of sums of logarithms."""
    total = mean = 0.0
    for plus in MU:
        for minus in MU:
            good, bad = silence(plus, minus)
            weight = (1 - plus) ** praised * (1 - minus) ** blamed * good**right * bad**wrong
            total += weight
            mean += weight * math.log(good / bad)
    return mean / total


def test_answers_weigh_as_in_sabl_while_nobody_is_silent() -> None:
    """eps 0.2: praise of UP + ln 4, blame of LEFT - ln 4; errors 1 - 1/4 and 0 - 1/7."""
    pupil = Pupil("isabl", explore=0.0)
    assert pupil.do(S0, UP, 0.0, rewards(1.0), S1) == pytest.approx((0.75, 0.75, 1.0))
    assert pupil.do(S0, LEFT, 0.0, rewards(-1.0), S1) == pytest.approx((-1 / 7, -1 / 7, -1.0))
    assert pupil.values(S0) == pytest.approx([-math.log(4), 0, math.log(4), 0])


def test_silence_is_worth_what_the_strategies_make_of_it() -> None:
    """One praise (of UP in s0), one silence (LEFT in s1): n+ = 1, n- = 0.

    s1 is all alike before, and its first action, LEFT, is taken for the likely one: z_right = 1. The mean of
    ln(p(0 | right) / p(0 | wrong)), weighed by (1 - mu+) p(0 | right), is 0.0106: LEFT stays the likely one.
    A second praise makes who is silent about the right action less likely: -0.18, so LEFT falls behind,
    its silence counts as wrong, z_wrong = 1, and that is worth -0.6453.
    """
    pupil = Pupil("isabl", explore=0.0)
    pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    pupil.do(S1, LEFT, 0.0, (), S2)
    assert pupil.values(S1) == pytest.approx([worth(1, 0, 1, 0), 0, 0, 0])
    pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    assert pupil.values(S1) == pytest.approx([worth(2, 0, 0, 1), 0, 0, 0])
    assert pupil.values(S0) == pytest.approx([0, 0, 2 * math.log(4), 0])
    assert [round(worth(*counts), 4) for counts in ((1, 0, 1, 0), (2, 0, 1, 0), (2, 0, 0, 1))] == [
        0.0106,
        -0.18,
        -0.6453,
    ]


@pytest.mark.parametrize("spoken, sign", [(1, -1), (-1, 1)])
def test_the_silence_of_a_teacher_who_only_praises_is_blame_and_the_other_way_round(
    spoken: int, sign: int
) -> None:
    """UP is right in forty states; all four actions are tried in each."""
    pupil = Pupil("isabl", explore=0.0)
    for number in range(40):
        for action in range(4):
            said = 1 if action == UP else -1
            pupil.do(b"%d" % number, action, 0.0, rewards(said) if said == spoken else (), S1)
    pupil.do(S0, LEFT, 0.0, (), S1)
    assert math.copysign(1, pupil.values(S0)[LEFT]) == sign
    assert {pupil.choose(b"7", decision) for decision in range(20)} == {UP}


def fixed_policy(steps: list[tuple[int, int, int]]) -> dict[int, list[float]]:
    """Return the scores at the fixed point of expectation maximisation over whole histories."""
    states = {state for state, _, _ in steps}
    value = 0.0
    praised = sum(said > 0 for *_, said in steps)
    blamed = sum(said < 0 for *_, said in steps)
    while True:
        scores = {state: [0.0] * 4 for state in states}
        for state, action, said in steps:
            scores[state][action] += said * math.log((1 - EPS) / EPS) if said else value
        likely = {state: row.index(max(row)) for state, row in scores.items()}
        right = sum(said == 0 and likely[state] == action for state, action, said in steps)
        wrong = sum(said == 0 for *_, said in steps) - right
        after = worth(praised, blamed, right, wrong)
        if after == value:
            return scores
        value = after


def test_increments_come_to_the_fixed_point_of_whole_histories() -> None:
    """A teacher who praises 30 % of the right actions and blames 80 % of the wrong ones, six states."""
    random = Random(3)
    pupil = Pupil("isabl", explore=0.0)
    steps = []
    for _ in range(150):
        state, action = random.randrange(6), random.randrange(4)
        right = action == state % 4
        said = (1 if right else -1) if random.random() < (0.3 if right else 0.8) else 0
        steps.append((state, action, said))
        pupil.do(b"%d" % state, action, 0.0, rewards(said) if said else (), S1)
    for state, scores in fixed_policy(steps).items():
        assert pupil.values(b"%d" % state) == pytest.approx(scores, abs=1e-6)


def test_a_policy_that_is_held_for_an_episode_acts_on_what_was_learnt_before_it() -> None:
    held, at_once = (Pupil("isabl", explore=0.0, update=update) for update in ("episode", "step"))
    for pupil in (held, at_once):
        pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    assert held.values(S0) == at_once.values(S0) == pytest.approx([0, 0, math.log(4), 0])
    assert {held.choose(S0, decision) for decision in range(40)} == {0, 1, 2, 3}
    assert {at_once.choose(S0, decision) for decision in range(40)} == {UP}
    held.begin(1)
    assert {held.choose(S0, decision) for decision in range(40)} == {UP}
    assert {held.choose(S2, decision) for decision in range(40)} == {0, 1, 2, 3}
