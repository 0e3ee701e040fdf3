"""The online aggregate: what it concludes, what it learns, and what it must not."""

from math import log, sqrt

import pytest

from sfid_core.crowd.online import Conclusion, CrowdMethod, CrowdSettings, OnlineAggregate, Standing
from sfid_core.learning.parameters import ParameterError
from tests.core.crowd.crowds import ADVERSARY, SPAMMER, K, decisions

EVERY_METHOD = pytest.mark.parametrize("method", CrowdMethod)
PROBABILISTIC = pytest.mark.parametrize("method", [CrowdMethod.ONE_COIN, CrowdMethod.DAWID_SKENE])


def fresh(method: CrowdMethod = CrowdMethod.ONE_COIN, **changed: float) -> OnlineAggregate:
    return OnlineAggregate(K, CrowdSettings(method=method, **changed))  # type: ignore[arg-type]


def taught(
    accuracies: list[float], method: CrowdMethod = CrowdMethod.ONE_COIN, count: int = 200, **changed: float
) -> OnlineAggregate:
    aggregate = fresh(method, **changed)
    for decision in decisions(accuracies, seed=7, count=count):
        aggregate.learn(decision.labels)
    return aggregate


def test_three_strangers_are_weighed_as_computed_by_hand() -> None:
    aggregate = fresh()
    labels = {"ann": 0, "bob": 0, "cid": 1}
    found = aggregate.conclude(labels)
    weight = log(
        3 * 4 / 2
    )  # ln((K - 1) s / (1 - s)) of the prior's s = 4 / 6: each label multiplies the odds by 6
    assert found.posterior == pytest.approx((36 / 44, 6 / 44, 1 / 44, 1 / 44))
    assert found.action == 0
    assert found.weights == pytest.approx({"ann": weight, "bob": weight, "cid": weight})
    aggregate.learn(labels)
    mean = (4 + 6 / 44) / 7
    error = sqrt(mean * (1 - mean) / 8)
    assert aggregate.reliability("cid") == pytest.approx((mean, error, 1, Standing.UNKNOWN))
    assert aggregate.reliability("ann").mean == pytest.approx((4 + 36 / 44) / 7)
    assert aggregate.workers() == ("ann", "bob", "cid")


def test_majority_and_weighted_majority_share_out_the_vote() -> None:
    labels = {"ann": 0, "bob": 0, "cid": 1}
    assert fresh(CrowdMethod.MAJORITY).conclude(labels) == (
        (2 / 3, 1 / 3, 0.0, 0.0), 0, {"ann": 1.0, "bob": 1.0, "cid": 1.0}
    )  # fmt: skip
    aggregate = fresh(CrowdMethod.WEIGHTED)
    aggregate.learn(labels)
    good, poor = 5 / 7, 4 / 7
    found = aggregate.conclude({"ann": 0, "cid": 1})
    assert found.posterior == pytest.approx((good / (good + poor), poor / (good + poor), 0, 0))
    assert found.weights == pytest.approx({"ann": good, "cid": poor})


def test_a_stranger_is_weighed_by_a_matrix_as_by_a_coin() -> None:
    labels = {"ann": 0, "bob": 0, "cid": 1}
    coin, matrix = (
        fresh(method).conclude(labels) for method in (CrowdMethod.ONE_COIN, CrowdMethod.DAWID_SKENE)
    )
    assert matrix.posterior == pytest.approx(coin.posterior)
    assert matrix.weights == pytest.approx(coin.weights)


@EVERY_METHOD
def test_no_label_a_tie_and_too_little_agreement_are_abstentions(method: CrowdMethod) -> None:
    aggregate = fresh(method)
    uniform = Conclusion((0.25,) * K, None, {})
    assert aggregate.conclude({}) == uniform
    assert aggregate.conclude({"ann": None, "bob": None}) == uniform
    assert aggregate.conclude({"ann": 1, "bob": 2}).action is None
    assert aggregate.conclude({"ann": 1, "bob": 2, "cid": None}).action is None
    scattered = fresh(method, abstain_below=0.7).conclude({"ann": 3, "bob": 3, "cid": 0, "dot": 1, "eve": 2})
    assert scattered.action is None
    assert max(scattered.posterior) == scattered.posterior[3]
    assert fresh(method, abstain_below=0.3).conclude({"ann": 3, "bob": 3, "cid": 0}).action == 3


@EVERY_METHOD
def test_neither_the_order_of_workers_nor_that_of_actions_settles_a_tie(method: CrowdMethod) -> None:
    for labels in ({"ann": 0, "bob": 3}, {"ann": 3, "bob": 0}, {"bob": 0, "ann": 3}):
        assert fresh(method, abstain_below=0.0).conclude(labels).action is None


@EVERY_METHOD
def test_concluding_changes_nothing(method: CrowdMethod) -> None:
    aggregate = taught([0.8, 0.7, SPAMMER], method)
    before = [aggregate.reliability(worker) for worker in aggregate.workers()]
    first = aggregate.conclude({"w0": 1, "w1": 2, "stranger": 2})
    assert aggregate.conclude({"w0": 1, "w1": 2, "stranger": 2}) == first
    assert [aggregate.reliability(worker) for worker in aggregate.workers()] == before
    assert "stranger" not in aggregate.workers()


@EVERY_METHOD
def test_the_same_calls_give_the_same_bits_whatever_the_order_inside_a_decision(method: CrowdMethod) -> None:
    one, other = fresh(method), fresh(method)
    for decision in decisions([0.9, 0.8, SPAMMER, ADVERSARY, 0.6], seed=3, count=300):
        one.learn(decision.labels)
        other.learn(dict(reversed(decision.labels.items())))
    labels: dict[str, int | None] = {"w0": 0, "w1": 1, "w2": 1, "w3": 2, "w4": 3}
    assert one.conclude(labels) == other.conclude(dict(reversed(labels.items())))
    assert [one.reliability(w) for w in one.workers()] == [other.reliability(w) for w in other.workers()]


@EVERY_METHOD
def test_replaying_without_a_worker_forgets_the_worker(method: CrowdMethod) -> None:
    without, never = fresh(method), fresh(method)
    for decision in decisions([0.9, 0.8, 0.7, ADVERSARY], seed=5, count=120):
        kept = {worker: label for worker, label in decision.labels.items() if worker != "w3"}
        without.learn(kept)
        never.learn(kept | {"w3": None})
    assert without.workers() == never.workers() == ("w0", "w1", "w2")
    assert without.reliability("w3") == fresh(method).reliability("nobody")
    assert [without.reliability(w) for w in without.workers()] == [
        never.reliability(w) for w in never.workers()
    ]


@EVERY_METHOD
def test_naming_another_optimum_costs_no_reliability(method: CrowdMethod) -> None:
    excused, judged = fresh(method), fresh(method)
    labels = {"ann": 0, "bob": 0, "cid": 1, "dot": 2}
    for _ in range(30):
        excused.learn(labels, acceptable=frozenset({0, 1}))
        judged.learn(labels)
    stranger = fresh(method).reliability("cid").mean
    assert excused.reliability("cid").mean > stranger
    assert excused.reliability("cid") == pytest.approx(excused.reliability("ann"), abs=0.02)
    assert excused.reliability("dot").mean < stranger
    assert judged.reliability("cid").mean < stranger


@EVERY_METHOD
def test_an_optimum_named_against_everybody_else_costs_nothing_either(method: CrowdMethod) -> None:
    aggregate = fresh(method)
    means = [aggregate.reliability("ann").mean]
    for _ in range(60):
        aggregate.learn({"ann": 3, "bob": 0, "cid": 0, "dot": 0, "eve": 0}, acceptable=frozenset({3}))
        means.append(aggregate.reliability("ann").mean)
    assert means == sorted(means)


@EVERY_METHOD
def test_gold_judges_against_the_crowd_and_with_the_weight_of_several(method: CrowdMethod) -> None:
    aggregate = fresh(method)
    aggregate.learn({"ann": 2, "bob": 1, "cid": 1}, gold=2)
    assert aggregate.reliability("ann")[:3:2] == ((4 + 5) / (6 + 5), 1)
    assert aggregate.reliability("bob").mean == pytest.approx(4 / (6 + 5))
    before = aggregate.conclude({"ann": 0, "bob": 1})
    aggregate.learn({"ann": None}, gold=3)
    assert aggregate.conclude({"ann": 0, "bob": 1}) == before


def test_a_gold_state_has_one_optimal_action() -> None:
    aggregate = fresh()
    with pytest.raises(ParameterError, match="a gold state has one optimal action"):
        aggregate.learn({"ann": 0}, acceptable=frozenset({0, 1}), gold=0)
    aggregate.learn({"ann": 0}, acceptable=frozenset({0}), gold=0)
    assert aggregate.reliability("ann").labels == 1


@EVERY_METHOD
def test_a_label_that_stands_alone_teaches_nothing(method: CrowdMethod) -> None:
    aggregate = fresh(method)
    for _ in range(50):
        aggregate.learn({"ann": 2, "bob": None})
    assert aggregate.workers() == ()
    assert aggregate.reliability("ann").labels == 0


def test_a_tied_majority_teaches_nothing() -> None:
    aggregate = fresh(CrowdMethod.MAJORITY)
    aggregate.learn({"ann": 0, "bob": 1})
    assert aggregate.workers() == ()


@EVERY_METHOD
def test_good_workers_spammers_and_adversaries_are_told_apart(method: CrowdMethod) -> None:
    crowd = [0.85, 0.85, 0.85, 0.85, 0.85, SPAMMER, ADVERSARY]
    aggregate = taught(crowd, method)
    found = [aggregate.reliability(f"w{number}") for number in range(len(crowd))]
    assert [worker.standing for worker in found] == [Standing.GOOD] * 5 + [Standing.SPAM, Standing.ADVERSARY]
    for worker, accuracy in zip(found, crowd, strict=True):
        assert worker.labels == (191 if method is CrowdMethod.MAJORITY else 200)  # ties teach it nothing
        assert abs(worker.mean - accuracy) < 0.1


def test_a_spammer_weighs_nothing_and_an_adversary_counts_against_what_it_names() -> None:
    aggregate = taught([0.85, 0.85, 0.85, 0.85, SPAMMER, ADVERSARY])
    assert aggregate.conclude({"w4": 1, "w0": 0}).weights["w4"] == 0.0
    found = aggregate.conclude({"w5": 1})
    assert found.weights["w5"] < 0
    assert found.posterior[1] == min(found.posterior) < 0.25
    assert found.action is None  # what it names is wrong; which of the others is right, it does not say


def test_few_honest_workers_are_taken_for_spammers_and_most_spammers_are_found_after_sixty_labels() -> None:
    crowd = [0.8] * 14 + [SPAMMER] * 6
    standings = []
    for seed in range(20):
        aggregate = fresh()
        for decision in decisions(crowd, seed, count=60):
            aggregate.learn(decision.labels)
        standings.append([aggregate.reliability(f"w{number}").standing for number in range(20)])
    honest = [taken for row in standings for taken in row[:14]]
    spammers = [taken for row in standings for taken in row[14:]]
    assert honest.count(Standing.GOOD) >= 0.98 * len(honest)
    assert spammers.count(Standing.GOOD) <= 0.05 * len(spammers)


def test_a_worker_who_turns_bad_is_noticed_sooner_with_forgetting() -> None:
    means = []
    for forgetting in (1.0, 0.98):
        aggregate = fresh(forgetting=forgetting)
        for accuracies in ([0.9] * 4, [0.9, 0.9, 0.9, ADVERSARY]):
            for decision in decisions(accuracies, seed=1, count=150):
                aggregate.learn(decision.labels)
        means.append(aggregate.reliability("w3").mean)
    assert means[1] < 0.15 < means[0]


@PROBABILISTIC
def test_no_worker_of_a_crowd_holds_more_than_the_cap(method: CrowdMethod) -> None:
    capped, free = (
        taught([0.99, 0.6, 0.6, 0.6, 0.6], method, count=400, influence_cap=cap) for cap in (0.25, 1.0)
    )
    labels: dict[str, int | None] = {"w0": 0, "w1": 1, "w2": 1, "w3": 2, "w4": 3}
    assert free.conclude(labels).weights["w0"] > capped.conclude(labels).weights["w0"] > 0
    assert free.conclude(labels).action == 0
    assert capped.conclude(labels).posterior[0] < free.conclude(labels).posterior[0]


@PROBABILISTIC
def test_gold_states_overrule_a_hostile_majority(method: CrowdMethod) -> None:
    """Two of 0.9 against three who agree on one wrong action."""
    right = {True: 0, False: 0}
    for seed in range(5):
        for with_gold in right:
            aggregate = fresh(method, abstain_below=0.0)
            for number, decision in enumerate(decisions([0.9, 0.9], seed, count=200)):
                lie = (decision.truth + 1 + number % 3) % K
                labels = decision.labels | {"x": lie, "y": lie, "z": lie}
                right[with_gold] += number >= 100 and aggregate.conclude(labels).action == decision.truth
                aggregate.learn(labels, gold=decision.truth if with_gold and number % 5 == 0 else None)
    assert right[False] == 0
    assert right[True] >= 0.75 * 500


def test_confusions_with_a_system_are_seen_through_by_matrices_alone() -> None:
    """Four who call 1 a 2 and 2 a 1, known from gold: their 1 speaks for 2."""
    swap = {0: 0, 1: 2, 2: 1, 3: 3}
    actions = {}
    for method in (CrowdMethod.ONE_COIN, CrowdMethod.DAWID_SKENE):
        aggregate = fresh(method)
        for number in range(40):
            truth = number % K
            aggregate.learn(dict.fromkeys("abcd", swap[truth]), gold=truth)
        actions[method] = aggregate.conclude(dict.fromkeys("abcd", 1)).action
    assert actions == {CrowdMethod.ONE_COIN: 1, CrowdMethod.DAWID_SKENE: 2}


def test_matrices_are_estimated_from_the_latest_labels_alone() -> None:
    """The history is bounded: what a worker was before it, the refreshed matrices no longer know."""
    aggregate = fresh(CrowdMethod.DAWID_SKENE, history_max=400, forgetting=1.0)
    for accuracies, count in (([0.9, 0.9, 0.9, ADVERSARY], 300), ([0.9] * 4, 250)):
        for decision in decisions(accuracies, seed=2, count=count):
            aggregate.learn(decision.labels)
    assert aggregate.reliability("w3").mean > 0.75


@pytest.mark.parametrize(
    "changed, named",
    [
        ({"abstain_below": 1.1}, "abstain_below 1.1 is outside 0 to 1: 0.6 is usual"),
        ({"abstain_below": float("nan")}, "abstain_below nan is outside"),
        ({"prior_right": 0.0}, "prior_right 0.0 is outside 0.001 to 1,000: 4.0 is usual"),
        ({"prior_wrong": -1.0}, "prior_wrong -1.0 is outside"),
        ({"forgetting": 0.4}, "forgetting 0.4 is outside"),
        ({"influence_cap": 0.0}, "influence_cap 0.0 is outside"),
        ({"spam_after": 0}, "spam_after 0 is outside 1 to 1,000,000: 20 is usual"),
        ({"gold_weight": 101.0}, "gold_weight 101.0 is outside"),
        ({"diagonal_prior": 0.0}, "diagonal_prior 0.0 is outside"),
        ({"history_max": 10}, "history_max 10 is outside"),
        ({"method": "sorcery"}, "crowd method 'sorcery' is unknown: choose one of majority, weighted"),
    ],
)
def test_settings_outside_their_range_are_refused_with_the_mend(
    changed: dict[str, float], named: str
) -> None:
    with pytest.raises(ParameterError) as refused:
        CrowdSettings(**changed)  # type: ignore[arg-type]
    assert str(refused.value).startswith(named)


def test_actions_outside_the_world_are_refused_with_who_named_them() -> None:
    aggregate = fresh()
    with pytest.raises(ParameterError, match="action 4 of worker 'ann' is outside"):
        aggregate.conclude({"ann": 4})
    with pytest.raises(ParameterError, match="action -1 of worker 'bob' is outside"):
        aggregate.learn({"bob": -1})
    with pytest.raises(ParameterError, match="action 9 of the solver is outside"):
        aggregate.learn({"bob": 1}, gold=9)
    with pytest.raises(ParameterError, match="actions 1 is outside"):
        OnlineAggregate(1, CrowdSettings())
