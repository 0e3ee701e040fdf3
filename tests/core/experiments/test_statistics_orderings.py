"""Orderings told as data become claims with intervals."""

import numpy as np
import pytest

from sfid_core.experiments.errors import ExperimentError
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.orderings import Ordering, Robustness, ordering_claims
from sfid_core.experiments.summary import Arm

RNG = np.random.default_rng(30)
SUCCESS = {
    ("sfid", "perfect"): 0.65,
    ("coach", "perfect"): 0.78,
    ("sfid", "noisy"): 0.49,
    ("coach", "noisy"): 0.41,
}
ARMS = [
    Arm(*name, {}, {"success": np.clip(mean + RNG.normal(0, 0.1, size=100), 0, 1)})
    for name, mean in SUCCESS.items()
]
TABLE: list[Ordering | Robustness] = [
    Ordering("coach", "sfid", "perfect"),
    Ordering("coach", "sfid", "noisy"),
    Robustness("sfid", "coach", "noisy", "perfect"),
    Robustness("coach", "sfid", "noisy", "perfect"),
]


def test_a_table_of_orderings_becomes_claims() -> None:
    claims = ordering_claims(ARMS, TABLE, Resampling())
    assert [(claim.claim, claim.holds) for claim in claims] == [
        ("with the teacher perfect, coach has more success than sfid", True),
        ("with the teacher noisy, coach has more success than sfid", False),
        ("from perfect to noisy, sfid loses less success than coach", True),
        ("from perfect to noisy, coach loses less success than sfid", False),
    ]
    assert [claim.difference for claim in claims] == pytest.approx([0.13, -0.08, -0.21, 0.21], abs=0.04)


def test_claims_of_one_table_share_the_level() -> None:
    together = ordering_claims(ARMS, TABLE, Resampling())
    alone = ordering_claims(ARMS, TABLE, Resampling(), simultaneous=False)
    assert [claim.level for claim in together] == [0.9875] * 4
    assert [claim.level for claim in alone] == [0.95] * 4
    for wide, narrow in zip(together, alone, strict=True):
        assert wide.ci.lo < narrow.ci.lo < narrow.ci.hi < wide.ci.hi


def test_an_arm_that_was_not_run_is_named() -> None:
    with pytest.raises(ExperimentError, match="success of the arm tamer, noisy: add it to the experiment"):
        ordering_claims(ARMS, [Ordering("sfid", "tamer", "noisy")], Resampling())
    with pytest.raises(ExperimentError, match="need effort of the arm sfid, noisy"):
        ordering_claims(ARMS, [Ordering("sfid", "coach", "noisy", "effort")], Resampling())
