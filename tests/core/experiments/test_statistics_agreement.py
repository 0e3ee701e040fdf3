"""The stop rule: since when the agent acts as the teacher prefers."""

import numpy as np
import pytest

from sfid_core.experiments.agreement import (
    CENSORED,
    agreement_totals,
    inputs_until,
    onset,
)
from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.summary import Arm, summarise

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
