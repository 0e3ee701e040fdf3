"""TAMER against updates computed by hand: samples, silence, credit in real time."""

import pytest

from sfid_core.learning.kernels import Learned
from tests.core.learning.pupil import DOWN, LEFT, S0, S1, S2, UP, Pupil, rewards


def test_three_samples_computed_by_hand() -> None:
    """alpha 0.5: H(s0, UP) = 0 + 0.5 * (1 - 0) = 0.5; + 0.5 * (1 - 0.5) = 0.75; + 0.5 * (-1 - 0.75) = -0.125.

    The reward of the environment is not looked at.
    """
    tamer = Pupil("tamer", alpha=0.5)
    assert tamer.do(S0, UP, 7.0, rewards(1.0), S1) == Learned(1.0, 1.0, 1.0)
    assert tamer.do(S0, UP, 7.0, rewards(1.0), S1) == Learned(0.5, 0.5, 1.0)
    assert tamer.do(S0, UP, 7.0, rewards(-1.0)) == Learned(-1.75, -1.75, -1.0)
    assert tamer.rounded(S0) == [0, 0, -0.125, 0]
    assert {tamer.choose(S0, decision) for decision in range(50)} == {0, 1, 3}


@pytest.mark.parametrize(
    "silence, expected, states", [("skip", 0.5, 1), ("zero", 0.25, 2), ("decay", 0.45, 2)]
)
def test_what_a_silent_step_teaches(silence: str, expected: float, states: int) -> None:
    """H = 0.5 after one praise, alpha 0.5. Skipped: 0.5. A sample of 0: 0.5 - 0.5 * 0.5. Forget 0.1: 0.45."""
    tamer = Pupil("tamer", alpha=0.5, silence=silence)
    tamer.do(S0, UP, 0.0, rewards(1.0), S0)
    assert tamer.do(S0, UP, 0.0, (), S1) == Learned(0.0, 0.0, 0.0)
    tamer.do(S1, UP)
    assert tamer.rounded(S0) == [0, 0, expected, 0]
    assert len(tamer) == states


def test_credit_for_the_previous_step_stays_within_the_episode() -> None:
    """s1, LEFT with praise, for UP before; the end with blame, for LEFT. Then a first step: for nobody."""
    tamer = Pupil("tamer", alpha=1.0, credit="previous")
    tamer.do(S0, UP, 0.0, rewards(1.0), S1)
    tamer.do(S1, LEFT, 0.0, rewards(1.0), S2)
    tamer.do(S2, DOWN, 0.0, rewards(-1.0))
    tamer.begin(1)
    tamer.do(S0, DOWN, 0.0, rewards(-1.0), S1)
    assert (tamer.rounded(S0), tamer.rounded(S1)) == ([0, 0, 1, 0], [-1, 0, 0, 0])
    assert tamer.rounded(S2) == [0, 0, 0, 0]


def seen(tamer: Pupil) -> None:
    """Three steps of 400 ms each, praise at the end of the second."""
    tamer.do(S0, UP, 0.0, (), S1, span_ms=400)
    tamer.do(S1, LEFT, 0.0, rewards(1.0), S2, delay_ms=400, span_ms=400)
    tamer.do(S2, DOWN, 0.0, (), S0, span_ms=400)


def test_in_real_time_a_reward_is_a_sample_of_each_step_weighed_by_its_credit() -> None:
    """Delays are 200 to 800 ms. The praise came 0 to 400 ms after LEFT was seen, 400 to 800 ms after UP.

    Credit of LEFT: 200 of the 600 ms; of UP: 400 of the 600. alpha 1: H = 0 + 1 * credit * (1 - 0).
    """
    tamer = Pupil("tamer", alpha=1.0, credit="individual")
    seen(tamer)
    assert tamer.values(S0)[UP] == pytest.approx(2 / 3)
    assert tamer.values(S1)[LEFT] == pytest.approx(1 / 3)
    assert tamer.rounded(S2) == [0, 0, 0, 0]


def test_in_real_time_the_credited_rewards_of_a_step_add_up_to_its_one_sample() -> None:
    """As above. After the third step UP ended 800 ms ago: its sample is closed, at 2/3.

    The episode ends there. LEFT, 400 to 800 ms ago: 2/3 of its credit could have come (the mean over
    lags x of (x - 200) / 600), so 1/3 counts as (1/3) / (2/3) = 0.5. DOWN, 0 to 400 ms ago: 1/12 could have
    come, less than half, and it is left out.
    """
    tamer = Pupil("tamer", alpha=1.0, credit="aggregate", silence="zero")
    seen(tamer)
    assert tamer.values(S0)[UP] == pytest.approx(2 / 3)
    assert tamer.rounded(S1) == [0, 0, 0, 0]
    tamer.begin(1)
    assert tamer.values(S1)[LEFT] == pytest.approx(0.5)
    assert len(tamer) == 2


@pytest.mark.parametrize("credit", ["aggregate", "individual"])
def test_a_step_without_a_duration_takes_all_the_credit(credit: str) -> None:
    tamer = Pupil("tamer", alpha=0.5, credit=credit)
    tamer.do(S0, UP, 0.0, rewards(1.0), S1)
    tamer.do(S1, LEFT, 0.0, rewards(-1.0), S2)
    tamer.begin(1)
    assert (tamer.rounded(S0), tamer.rounded(S1)) == ([0, 0, 0.5, 0], [-0.5, 0, 0, 0])


def test_an_answer_takes_no_longer_than_the_end_of_the_window() -> None:
    """Praise 600 to 1000 ms after the step was seen; answers take 200 to 800: credit 200 of the 600 ms."""
    tamer = Pupil("tamer", alpha=1.0, credit="individual")
    tamer.do(S0, UP, 0.0, rewards(1.0), S1, delay_ms=1000, span_ms=400)
    assert tamer.rounded(S0) == [0, 0, round(1 / 3, 9), 0]


def test_a_sample_stays_open_as_long_as_an_answer_can_still_be_about_its_step() -> None:
    """Steps of 700 ms; praise 50 ms into the third, 750 to 1450 ms after the first: credit 50 of 600 ms."""
    tamer = Pupil("tamer", alpha=1.0, credit="aggregate")
    tamer.do(S0, UP, 0.0, (), S1, span_ms=700)
    tamer.do(S1, LEFT, 0.0, (), S2, span_ms=700)
    tamer.do(S2, DOWN, 0.0, rewards(1.0), S0, delay_ms=50, span_ms=700)
    assert tamer.rounded(S0) == [0, 0, round(50 / 600, 9), 0]


def test_a_long_step_cut_off_by_the_end_counts_by_the_answers_that_could_have_come() -> None:
    """2000 ms, praise after 500: credit 300 of 600 ms. Mean over lags x of min((x - 200) / 600, 1): 0.75."""
    tamer = Pupil("tamer", alpha=1.0, credit="aggregate")
    tamer.do(S0, UP, 0.0, rewards(1.0), S1, delay_ms=500, span_ms=2000)
    assert tamer.rounded(S0) == [0, 0, 0, 0]
    tamer.begin(1)
    assert tamer.rounded(S0) == [0, 0, round(0.5 / 0.75, 9), 0]


def test_every_episode_samples_its_first_step_anew() -> None:
    """As in the test of the one sample: 2/3 of the praise, then, alpha being 1, 2/3 of the blame."""
    tamer = Pupil("tamer", alpha=1.0, credit="aggregate")
    seen(tamer)
    tamer.begin(1)
    tamer.steps = 0
    tamer.do(S0, UP, 0.0, (), S1, span_ms=400)
    tamer.do(S1, LEFT, 0.0, rewards(-1.0), S2, delay_ms=400, span_ms=400)
    tamer.do(S2, DOWN, 0.0, (), S0, span_ms=400)
    assert tamer.rounded(S0) == [0, 0, round(-2 / 3, 9), 0]
