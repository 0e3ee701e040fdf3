"""How many teachers an agent needs: a crowd's session, what is compared, and what random members cost."""

import numpy as np
import pytest

from sfid_core.crowd.settings import CrowdMethod, CrowdSettings
from sfid_core.experiments.crowd import (
    RANDOM_SHARE,
    CrowdCondition,
    arm,
    beside,
    claims,
    compared,
    random_share,
    sweep,
    without_random,
)
from sfid_core.experiments.crowd_lane import MEASURED
from sfid_core.experiments.intervals import Resampling
from sfid_core.experiments.summary import Arm
from sfid_core.learning.parameters import ParameterError
from sfid_core.session.config import WorldSpec
from sfid_core.sokoban.levels import packaged

ROOM = WorldSpec(packaged("room")[0].to_xsb(), "room", "all")
SEEDS = tuple(range(12))


def ran(mix: str, method: CrowdMethod = CrowdMethod.ONE_COIN, seeds: tuple[int, ...] = SEEDS) -> Arm:
    condition = CrowdCondition(mix, ROOM, CrowdSettings(method=method))
    return arm(condition, condition.run(condition.batch(), seeds))


def mean(one: Arm, what: str) -> float:
    return float(one.totals[what].mean())


def test_thirty_percent_random_members_cost_a_good_crowd_at_most_five_points() -> None:
    (claim,) = claims([ran("good:14,random:6"), ran("good:14")], Resampling(resamples=500))
    assert claim.claim == (
        "good:14 solves at most 5 points fewer starts with 30% random members (good:14,random:6)"
    )
    assert claim.difference > -0.05
    assert (claim.margin, claim.n_seeds) == (0.05, len(SEEDS))


def test_the_claim_is_refuted_where_random_members_cost_more_than_they_may() -> None:
    with_them = Arm("one-coin", "good:7,random:3", {}, {"success": np.linspace(0.3, 0.4, 12)})
    without = Arm("one-coin", "good:7", {}, {"success": np.linspace(0.4, 0.5, 12)})
    (claim,) = claims([with_them, without], Resampling(resamples=500))
    assert (claim.holds, round(claim.difference, 9)) == (False, -0.1)


def test_a_claim_of_few_seeds_does_not_hold_however_good_it_looks() -> None:
    same = {"success": np.full(9, 0.5)}
    arms = [Arm("one-coin", name, {}, same) for name in ("good:7,random:3", "good:7")]
    (claim,) = claims(arms, Resampling())
    assert (claim.holds, claim.difference) == (False, 0.0)


def test_a_crowd_without_its_random_members_is_found_also_when_all_of_it_is_random() -> None:
    assert [without_random(mix) for mix in ("good:2, random:1", "random:3", "expert:1")] == [
        "good:2",
        "",
        "expert:1",
    ]
    conditions = compared(["random:3", "good:2, random:1", "good:2"], ROOM, CrowdSettings())
    assert [one.mix for one in conditions] == [
        "random:3",
        "good:2,random:1",
        "good:2",
    ]


def test_a_sweep_has_every_crowd_alone_and_with_three_in_ten_at_random() -> None:
    conditions = sweep(ROOM, CrowdSettings(), (1, 7, 14))
    assert [one.mix for one in conditions[:6]] == [
        "careless:1",
        "careless:1,random:1",
        "careless:7",
        "careless:7,random:3",
        "careless:14",
        "careless:14,random:6",
    ]
    assert random_share("good:14,random:6") == pytest.approx(RANDOM_SHARE)
    assert [beside(size) for size in (1, 7, 14)] == [1, 3, 6]
    assert len({one.digest for one in conditions}) == len(conditions) == 18


def test_what_changes_the_results_changes_the_digest_and_what_does_not_does_not() -> None:
    base = CrowdCondition("good:2", ROOM)
    changed = [
        CrowdCondition("good:3", ROOM),
        CrowdCondition("good:2", ROOM, CrowdSettings(abstain_below=0.5)),
        CrowdCondition("good:2", ROOM, solver=False),
        CrowdCondition("good:2", ROOM, episodes=29),
    ]
    assert base.digest not in {one.digest for one in changed}
    assert CrowdCondition("good:2", ROOM, quality="80 % right", size=2).digest == base.digest


def test_one_expert_is_always_right_and_always_heard() -> None:
    one = ran("expert:1", CrowdMethod.MAJORITY)
    assert (mean(one, "accuracy"), mean(one, "spoken")) == (1.0, 1.0)
    assert one.totals["labels"].tolist() == one.totals["inputs"].tolist()


def test_more_members_are_right_more_often_and_teach_more() -> None:
    one, many = ran("careless:1", seeds=SEEDS[:6]), ran("careless:20", seeds=SEEDS[:6])
    assert mean(many, "accuracy") > mean(one, "accuracy") + 0.2
    assert mean(many, "success") > mean(one, "success") + 0.1


def test_adversaries_outnumbered_are_seen_through_by_one_coin_and_not_by_a_majority() -> None:
    mix, few = "good:4,adversary:3", SEEDS[:4]
    coin, votes = ran(mix, seeds=few), ran(mix, CrowdMethod.MAJORITY, few)
    said = [mean(one, "accuracy") * mean(one, "spoken") for one in (coin, votes)]
    assert said[0] > said[1] + 0.2


def test_the_same_seeds_give_the_same_bits_in_any_order_and_company() -> None:
    condition = CrowdCondition("good:3,random:2", ROOM)
    batch = condition.batch()
    together = condition.run(batch, [3, 1, 2])
    assert together.shape == (3, condition.rows, len(MEASURED))
    apart = [condition.run(condition.batch(), [seed])[0] for seed in (3, 1, 2)]
    np.testing.assert_array_equal(together, np.array(apart))


def test_a_crowd_of_nobody_that_there_is_is_refused_with_the_mend() -> None:
    with pytest.raises(ParameterError, match="mix 'wise:3' is not KIND:COUNT"):
        compared(["wise:3"], ROOM, CrowdSettings())
