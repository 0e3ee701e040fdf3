"""Advise against policies computed by hand."""

import math
from collections import Counter
from random import Random

import pytest

from sfid_core.learning.kernels import Learned
from sfid_core.learning.methods import method_named
from sfid_core.teaching.answers import Answer, AnswerKind
from tests.core.learning.pupil import LEFT, S0, S1, UP, Pupil, labels, rewards


def shares(pupil: Pupil) -> list[float]:
    """Return the probabilities behind the preferences in s0."""
    weights = [math.exp(value) for value in pupil.values(S0)]
    return [weight / sum(weights) for weight in weights]


def told(consistency: float = 0.8, optima: str = "one") -> Pupil:
    """UP praised twice, LEFT blamed once: D = (-1, 0, 2, 0)."""
    pupil = Pupil("advise", alpha=0.5, consistency=consistency, optima=optima)
    pupil.do(S0, UP, 0.0, rewards(1.0), S1)
    pupil.do(S0, UP, 0.0, rewards(0.3), S1)
    pupil.do(S0, LEFT, 0.0, rewards(-1.0), S1)
    return pupil


def test_one_optimum_makes_answers_for_an_action_evidence_against_the_others() -> None:
    """C = 0.8: C / (1 - C) = 4; pi ~ 4**D = (0.25, 1, 16, 1), together 18.25."""
    pupil = told(consistency=0.8)
    assert shares(pupil) == pytest.approx([0.25 / 18.25, 1 / 18.25, 16 / 18.25, 1 / 18.25])
    counts = Counter(pupil.choose(S0, decision) for decision in range(4000))
    assert counts[UP] == pytest.approx(4000 * 16 / 18.25, abs=100)
    assert counts[LEFT] == pytest.approx(4000 * 0.25 / 18.25, abs=40)


def test_several_optima_leave_each_action_its_own_evidence() -> None:
    """C**D / (C**D + (1 - C)**D) with C = 0.8: 1/5, 1/2, 16/17, 1/2."""
    weights = [1 / 5, 1 / 2, 16 / 17, 1 / 2]
    expected = [weight / sum(weights) for weight in weights]
    assert shares(told(optima="several")) == pytest.approx(expected)


def test_the_values_multiply_in_and_learn_from_the_environment_alone() -> None:
    """Q(s0, LEFT) = 0.5 * 2 = 1, temperature 0.5: pi ~ 4**D * e**(Q / 0.5) with D = (1, 0, 0, 0)."""
    pupil = Pupil("advise", alpha=0.5, temperature=0.5)
    assert pupil.do(S0, LEFT, 2.0, rewards(1.0)) == Learned(2.0, 2.0, 1.0)
    total = 4 * math.exp(2) + 3
    assert shares(pupil) == pytest.approx([4 * math.exp(2) / total, 1 / total, 1 / total, 1 / total])


def test_a_label_counts_for_its_action_whichever_was_taken() -> None:
    """A label for UP while LEFT is taken, then a belief of 1/2 in UP and LEFT: D = (0.5, 0, 1.5, 0)."""
    pupil = Pupil("advise-labels")
    assert pupil.do(S0, LEFT, 0.0, labels(UP), S1).h == -1.0
    halves = Answer(AnswerKind.LABEL, action=UP, posterior=(0.5, 0.0, 0.5, 0.0))
    assert pupil.do(S0, UP, 0.0, [halves], S1).h == 0.0
    assert shares(pupil) == pytest.approx([2 / 12, 1 / 12, 8 / 12, 1 / 12])


def test_advise_asks_for_rewards_and_its_twin_for_labels() -> None:
    asked = [(one.asks_before, one.asks_after) for one in map(method_named, ("advise", "advise-labels"))]
    assert asked == [(None, AnswerKind.REWARD), (AnswerKind.LABEL, None)]


def test_far_evidence_neither_overflows_nor_vanishes() -> None:
    pupil = Pupil("advise", optima="several", consistency=0.99)
    for _ in range(400):
        pupil.do(S0, UP, 0.0, rewards(1.0), S1)
        pupil.do(S0, LEFT, 0.0, rewards(-1.0), S1)
    assert pupil.values(S0)[UP] == pytest.approx(0.0)
    assert pupil.values(S0)[LEFT] == pytest.approx(-400 * math.log(99))
    assert {pupil.choose(S0, decision) for decision in range(200)} >= {UP}
    assert LEFT not in {pupil.choose(S0, decision) for decision in range(200)}


def test_consistency_is_counted_where_earlier_answers_lead_by_two() -> None:
    """Prior 4 answers at 0.75; UP praised twice: nothing to compare with. Praise and blame then: 1 of 2.

    C = (3 + 1) / (4 + 1) = 0.8, then (3 + 1) / (4 + 2) = 2/3; D(UP) = 2 + 1 - 1 = 2.
    """
    pupil = Pupil("advise", consistency=0.75, estimate="online", prior_answers=4.0)
    odds = []
    for value in (1.0, 1.0, 1.0, -1.0):
        pupil.do(S0, UP, 0.0, rewards(value), S1)
        odds.append(math.exp(pupil.memory.scalars[0]))
    assert odds == pytest.approx([3, 3, 4, 2])
    assert shares(pupil) == pytest.approx([1 / 7, 1 / 7, 4 / 7, 1 / 7])
    pupil.begin(1)
    assert math.exp(pupil.memory.scalars[0]) == pytest.approx(2)


def test_labels_are_compared_with_the_action_that_leads_all_others() -> None:
    """UP, UP, then UP agrees and LEFT does not; a state where LEFT and UP are level tells nothing."""
    pupil = Pupil("advise-labels", consistency=0.75, estimate="online", prior_answers=4.0)
    for label in (UP, UP, UP, LEFT):
        pupil.do(S0, LEFT, 0.0, labels(label), S1)
    assert math.exp(pupil.memory.scalars[0]) == pytest.approx(2)
    for label in (UP, LEFT, UP, LEFT):
        pupil.do(S1, LEFT, 0.0, labels(label), S0)
    assert math.exp(pupil.memory.scalars[0]) == pytest.approx(2)


@pytest.mark.parametrize("truth", [0.65, 0.9])
def test_the_estimate_comes_to_the_teacher_s_consistency(truth: float) -> None:
    """60 states, 20 judgements each, of the right action and of a wrong one."""
    random = Random(4)
    pupil = Pupil("advise", consistency=0.8, estimate="online")
    for turn in range(20 * 60):
        right = random.random() < 0.5
        said = 1.0 if right == (random.random() < truth) else -1.0
        pupil.do(b"%d" % (turn % 60), UP if right else LEFT, 0.0, rewards(said), S1)
    odds = math.exp(pupil.memory.scalars[0])
    assert odds / (1 + odds) == pytest.approx(truth, abs=0.04)
