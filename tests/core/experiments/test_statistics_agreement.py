"""The stop rule: agreement by state, along greedy runs, and since when."""

import numpy as np
import pytest

from sfid_core.experiments.agreement import (
    CENSORED,
    agreement_totals,
    greedy_visits,
    inputs_until,
    onset,
    state_agreement,
    weighted_agreement,
)
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.summary import Arm, summarise

# A corridor 0 - 1 - 2 - 3 with the goal at 3: action 0 goes left, 1 goes right.
SUCCESSOR = np.array([[0, 1], [0, 2], [1, 3], [3, 3]], dtype=np.int32)
TERMINAL = np.array([False, False, False, True])
RIGHT = np.array([[False, True]] * 4)
GOES_RIGHT = np.array([[0.0, 1.0]] * 4)


def test_agreement_is_the_preferred_share_of_the_best_actions() -> None:
    values = np.array(
        [[0.0, 0.0, 0.0, 0.0], [1.0, 2.0, 2.0, 0.0], [3.0, 1.0, 1.0, 1.0], [0.0, 5.0, 1.0, 0.0]]
    )
    preferred = np.array(
        [
            [True, False, False, False],
            [False, True, True, False],
            [False, True, False, False],
            [True, True, False, False],
        ]
    )
    assert state_agreement(values, preferred).tolist() == [0.25, 1.0, 0.0, 1.0]
    many = state_agreement(np.stack([values, values + 7]), preferred)
    assert many.tolist() == [[0.25, 1.0, 0.0, 1.0]] * 2


def test_a_greedy_run_visits_each_state_of_its_way_once() -> None:
    assert greedy_visits(GOES_RIGHT, SUCCESSOR, TERMINAL, [0], 10).tolist() == [1, 1, 1, 0]
    assert greedy_visits(GOES_RIGHT, SUCCESSOR, TERMINAL, [0, 2, 3], 10).tolist() == pytest.approx(
        [1 / 3, 1 / 3, 2 / 3, 0]
    )
    assert greedy_visits(GOES_RIGHT, SUCCESSOR, TERMINAL, [0], 2).tolist() == [1, 1, 0, 0]


def test_ties_split_the_run() -> None:
    """From 2 with a tie there: half arrives, half goes back to 1 and comes again; 1/(1 - 1/2) visits."""
    tied = GOES_RIGHT.copy()
    tied[2] = 4.0
    assert greedy_visits(tied, SUCCESSOR, TERMINAL, [2], 200).tolist() == pytest.approx([0, 1, 2, 0])
    expected = greedy_visits(tied, SUCCESSOR, TERMINAL, [2], 3).tolist()
    assert expected == pytest.approx([0, 0.5, 1.5, 0])


def test_a_run_in_a_circle_is_cut_at_its_limit() -> None:
    goes_left = -GOES_RIGHT
    assert greedy_visits(goes_left, SUCCESSOR, TERMINAL, [1], 100).tolist() == [99, 1, 0, 0]


def test_agreement_is_weighted_by_visits() -> None:
    shares = state_agreement(np.array([[0, 1.0], [0, 0], [1.0, 0], [0, 0]]), RIGHT)
    assert shares.tolist() == [1, 0.5, 0, 0.5]
    assert weighted_agreement(shares, [[1, 1, 0, 0], [0, 1, 3, 0]]).tolist() == [0.75, 0.125]
    with pytest.raises(ExperimentError, match="agreement over no states"):
        weighted_agreement(shares, [[1, 1, 0, 0], [0, 0, 0, 0]])
    with pytest.raises(ExperimentError, match="at least one start state"):
        greedy_visits(GOES_RIGHT, SUCCESSOR, TERMINAL, [], 10)


AGREEMENT = np.array(
    [
        [0.2, 0.9, 0.9, 0.9, 0.9],  # from 1
        [0.9, 0.2, 0.9, 0.9, 0.2],  # from 2: a single good episode does not last
        [0.9, 0.9, 0.1, 0.1, 0.1],  # from 0, though it is lost again later
        [0.1, 0.1, 0.1, 0.1, 0.9],  # cut off before it has lasted
        [0.1, 0.1, 0.1, 0.1, 0.1],  # never
    ]
)


def test_agreement_starts_with_the_first_stretch_that_lasts() -> None:
    found = onset(AGREEMENT, 0.9, 2, Resampling())
    assert found.episodes.tolist() == [1, 2, 0, CENSORED, CENSORED]
    assert (found.censored, found.reached, found.median) == (2, 0.6, 2)
    assert found.needed().tolist() == [1, 2, 0, 5, 5]
    assert found.restricted_mean == pytest.approx(13 / 5)
    assert found.restricted_mean_ci.lo < 13 / 5 < found.restricted_mean_ci.hi
    assert found.reached_ci == pytest.approx((0.2307, 0.8824), abs=1e-4)


def test_where_fewer_than_half_agree_there_is_no_median() -> None:
    assert onset(AGREEMENT[[0, 3, 4]], 0.9, 2, Resampling()).median is None
    assert onset(AGREEMENT[[0, 4]], 0.9, 2, Resampling()).median == 1
    nobody = onset(AGREEMENT, 0.95, 1, Resampling())
    assert (nobody.censored, nobody.reached, nobody.median, nobody.restricted_mean) == (5, 0.0, None, 5.0)
    assert nobody.reached_ci.hi > 0.4


def test_answers_are_counted_up_to_agreement_and_to_the_end_where_there_is_none() -> None:
    found = onset(AGREEMENT, 0.9, 2, Resampling())
    inputs = np.tile([10, 8, 6, 4, 2], (5, 1))
    assert inputs_until(inputs, found.episodes).tolist() == [10, 18, 0, 30, 30]


def test_stretches_that_do_not_fit_into_the_run_are_refused() -> None:
    for n_lasting in (0, 6):
        with pytest.raises(ExperimentError, match="a stretch of 1 to n_episodes"):
            onset(AGREEMENT, 0.9, n_lasting, Resampling())


def test_the_totals_of_an_arm_say_what_came_of_agreement() -> None:
    inputs = np.tile([10, 8, 6, 4, 2], (5, 1))
    found = agreement_totals(AGREEMENT, inputs, 0.9, 2)
    assert {name: column.tolist() for name, column in found.items()} == {
        "agreement": [0.9, 0.2, 0.1, 0.9, 0.1],
        "agreed": [1, 1, 1, 0, 0],
        "episodes_to_agreement": [1, 2, 0, 5, 5],
        "labels_to_agreement": [10, 18, 0, 30, 30],
    }
    (summary,) = summarise([Arm("sfid", "expert", {}, found)], Resampling())
    share, ci = summary.totals["agreed"]
    assert share == 0.6
    assert ci == pytest.approx((0.2307, 0.8824), abs=1e-4)
