"""The accuracy bars: small hostile crowds decision by decision, and public sets of real people's labels."""

from collections.abc import Sequence

import numpy as np
import pytest

from sfid_core.crowd.em import TINY
from sfid_core.crowd.labels import Name, label_set
from sfid_core.crowd.methods import aggregate
from sfid_core.crowd.online import CrowdMethod, CrowdSettings, OnlineAggregate
from sfid_core.crowd.outcome import accuracy, decided
from tests.core.crowd.crowds import ADVERSARY, SPAMMER, Columns, decisions, real_set, systematic_set

REPETITIONS = 60
REAL_SETS = ("dog",)
WITH_ADVERSARIES = (0.8, 0.8, 0.8, ADVERSARY, ADVERSARY)
WITH_SPAMMERS = (0.9, 0.9, SPAMMER, SPAMMER, SPAMMER)


def late_accuracy(method: CrowdMethod, crowd: Sequence[float]) -> float:
    """Return the share right of the decisions 100 to 200 over all repetitions; m tied actions count 1/m."""
    right = []
    for seed in range(REPETITIONS):
        aggregate = OnlineAggregate(4, CrowdSettings(method=method))
        for number, decision in enumerate(decisions(crowd, seed, count=200)):
            if number >= 100:
                posterior = np.array(aggregate.conclude(decision.labels).posterior)
                best = np.flatnonzero(posterior >= posterior.max() - 1e-9)
                right.append((decision.truth in best) / len(best))
            aggregate.learn(decision.labels)
    return float(np.mean(right))


@pytest.mark.parametrize(
    "crowd, bar, majority", [(WITH_ADVERSARIES, 0.90, 0.72), (WITH_SPAMMERS, 0.88, 0.73)]
)
def test_a_hostile_crowd_is_read_right_where_the_majority_fails(
    crowd: Sequence[float], bar: float, majority: float
) -> None:
    assert late_accuracy(CrowdMethod.MAJORITY, crowd) == pytest.approx(majority, abs=0.015)
    assert late_accuracy(CrowdMethod.ONE_COIN, crowd) >= bar
    assert late_accuracy(CrowdMethod.DAWID_SKENE, crowd) >= bar
    assert late_accuracy(CrowdMethod.WEIGHTED, crowd) >= bar - 0.02


def test_what_a_live_crowd_says_is_seldom_wrong() -> None:
    """Below the threshold it abstains, so that of what is said at most one in twenty misleads the agent."""
    said = wrong = 0
    for seed in range(20):
        aggregate = OnlineAggregate(4, CrowdSettings())
        for number, decision in enumerate(decisions(WITH_ADVERSARIES, seed, count=200)):
            action = aggregate.conclude(decision.labels).action
            aggregate.learn(decision.labels)
            said += number >= 100 and action is not None
            wrong += number >= 100 and action not in (None, decision.truth)
    assert said >= 0.9 * 2000
    assert wrong <= 0.05 * said


def scored(columns: Columns, method: str) -> float:
    labels = label_set(columns.tasks, columns.workers, columns.labels)
    classes = decided(aggregate(labels, method).outcome.posterior, labels.task_names, seed=0)
    answers = {
        task: None if index is None else labels.class_names[index]
        for task, index in zip(labels.task_names, classes, strict=True)
    }
    return accuracy(answers, columns.truth)


def textbook(columns: Columns) -> float:
    """Return the accuracy of Dawid-Skene as their paper has it: no prior, one label after the other."""
    tasks, workers, classes = (sorted(set(column)) for column in columns[:3])
    rows = [
        (tasks.index(task), workers.index(worker), classes.index(label))
        for task, worker, label in zip(*columns[:3], strict=True)
    ]
    posterior = np.zeros((len(tasks), len(classes)))
    for task, _, label in rows:
        posterior[task, label] += 1
    posterior /= posterior.sum(axis=1, keepdims=True)
    for _ in range(30):
        matrices = np.full((len(workers), len(classes), len(classes)), TINY)
        for task, worker, label in rows:
            matrices[worker, :, label] += posterior[task]
        matrices /= matrices.sum(axis=2, keepdims=True)
        scores = np.tile(np.log(posterior.mean(axis=0)), (len(tasks), 1))
        for task, worker, label in rows:
            scores[task] += np.log(matrices[worker, :, label])
        posterior = np.exp(scores - scores.max(axis=1, keepdims=True))
        posterior /= posterior.sum(axis=1, keepdims=True)
    best: dict[Name, Name | None] = {
        task: classes[index] for task, index in zip(tasks, posterior.argmax(axis=1), strict=True)
    }
    return accuracy(best, columns.truth)


@pytest.mark.parametrize("name", REAL_SETS)
def test_on_real_labels_batch_and_online_stay_beside_the_textbook(name: str) -> None:
    columns = real_set(name)
    if columns is None:
        pytest.skip(f"the public label set {name!r} is not beside the project")
    expected = textbook(columns)
    assert scored(columns, "dawid-skene") == pytest.approx(expected, abs=0.005)
    assert scored(columns, "online-dawid-skene") >= expected - 0.02
    assert scored(columns, "online-one-coin") >= scored(columns, "one-coin") - 0.02
    assert scored(columns, "weighted") > scored(columns, "majority")


def test_systematic_errors_are_read_by_matrices_and_not_by_coins() -> None:
    for seed in range(3):
        columns = systematic_set(seed)
        expected = textbook(columns)
        assert scored(columns, "dawid-skene") == pytest.approx(expected, abs=0.01)
        assert scored(columns, "online-dawid-skene") >= expected - 0.02
        assert scored(columns, "one-coin") < expected - 0.04
