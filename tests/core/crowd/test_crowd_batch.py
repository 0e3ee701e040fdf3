"""Batch aggregation: index form, expectation maximisation against its equations, ties, and edge cases."""

import numpy as np
import pytest

from sfid_core.crowd.dawid_skene import dawid_skene
from sfid_core.crowd.em import SLOTS_MAX, Floats, Layout, Prior, Votes, log_likelihood, maximise, vote_shares
from sfid_core.crowd.evidence import influence_limit
from sfid_core.crowd.labels import LabelSet, Name, factorise, label_set
from sfid_core.crowd.majority import majority
from sfid_core.crowd.methods import NAMES, aggregate
from sfid_core.crowd.one_coin import one_coin
from sfid_core.crowd.outcome import accuracy, decided
from sfid_core.crowd.weighted import weighted_majority
from sfid_core.learning.parameters import ParameterError
from tests.core.crowd.crowds import sparse_set


def random_set(seed: int, tasks: int = 40, workers: int = 6, k: int = 3) -> LabelSet:
    """Return labels of two in three workers on each task, one worker absent from the first tasks."""
    chance = np.random.default_rng(seed)
    rows = [
        (task, worker, (task + int(chance.random() > 0.4 + 0.1 * worker)) % k)
        for task in range(tasks)
        for worker in range(workers)
        if chance.random() < 0.7 and (task > 5 or worker)
    ]
    return label_set(*(np.array(column) for column in zip(*rows, strict=True)))


def equations(labels: LabelSet, prior: Prior, iterations: int) -> Floats:
    """Return the posterior after so many iterations, label by label as the equations read."""
    votes, k = labels.votes, labels.votes.class_count
    rows = list(zip(votes.tasks, votes.workers, votes.labels, strict=True))
    q = vote_shares(votes)
    for _ in range(iterations):
        n = np.zeros((votes.worker_count, k, k))
        for task, worker, label in rows:
            n[worker, label] += q[task]
        scores = np.tile(np.log(q.mean(axis=0)), (votes.task_count, 1))
        for task, worker, label in rows:
            s = (prior.right + np.trace(n[worker])) / (prior.right + prior.wrong + n[worker].sum())
            for c in range(k):
                before = prior.labels * (s if c == label else (1 - s) / (k - 1))
                scores[task, c] += np.log(
                    (n[worker, label, c] + before) / (n[worker, :, c].sum() + prior.labels)
                )
        q = np.exp(scores)
        q /= q.sum(axis=1, keepdims=True)
    return q


@pytest.mark.parametrize("iterations", [1, 4])
def test_expectation_maximisation_follows_its_equations(iterations: int) -> None:
    labels, prior = random_set(1), Prior(labels=1.5, right=4, wrong=2)
    found = maximise(
        Layout(labels.votes), vote_shares(labels.votes), prior, iterations=iterations, tolerance=0
    )
    assert found.iterations == iterations
    np.testing.assert_allclose(found.posterior, equations(labels, prior, iterations), atol=1e-7)


def test_the_order_of_rows_changes_the_result_by_rounding_alone() -> None:
    labels = random_set(2)
    votes = labels.votes
    order = np.random.default_rng(0).permutation(len(votes.tasks))
    shuffled = votes._replace(
        tasks=votes.tasks[order], workers=votes.workers[order], labels=votes.labels[order]
    )
    for method in (majority, weighted_majority, one_coin, dawid_skene):
        one = method(labels)
        other = method(LabelSet(labels.task_names, labels.worker_names, labels.class_names, shuffled))
        for first, second in zip(one, other, strict=True):
            np.testing.assert_allclose(first, second, atol=1e-9)


@pytest.mark.parametrize("most", [40, SLOTS_MAX + 1])
def test_slots_and_runs_of_labels_come_to_the_same_scores(most: int) -> None:
    """Tasks of no, one, few and many labels; with very many the labels are added run by run."""
    chance = np.random.default_rng(3)
    tasks = np.repeat(np.array([5, 1, 2, 4]), [1, 7, 3, most])
    workers, labels = chance.integers(3, size=len(tasks)), chance.integers(2, size=len(tasks))
    table = chance.standard_normal((3, 2, 2))
    expected = np.zeros((7, 2))
    for task, worker, label in zip(tasks, workers, labels, strict=True):
        expected[task] += table[worker, label]
    np.testing.assert_allclose(Layout(Votes(tasks, workers, labels, 7, 3, 2)).scores(table), expected)


def test_known_posteriors_stay_and_teach() -> None:
    """One worker says 1 where the anchored truth is 0: the labels of that worker come to mean 0."""
    votes = Votes(np.arange(6), np.zeros(6, dtype=np.intp), np.ones(6, dtype=np.intp), 6, 1, 2)
    start = np.tile([1.0, 0.0], (6, 1))
    start[5] = 0.5
    fixed = np.array([True] * 5 + [False])
    found = maximise(Layout(votes), start, Prior(), fixed=fixed, iterations=5, tolerance=0)
    assert found.posterior[:5].tolist() == start[:5].tolist()
    assert found.posterior[5, 0] > 0.9


def test_weights_make_some_labels_count_more() -> None:
    votes = Votes(np.array([0, 1]), np.array([0, 0]), np.array([0, 1]), 2, 1, 2)
    counts = Layout(votes, np.array([3.0, 0.5])).confusion_counts(np.eye(2))
    assert counts.tolist() == [[[3.0, 0.0], [0.0, 0.5]]]


def test_probabilities_of_a_worker_without_labels_are_those_of_the_prior() -> None:
    table = np.exp(log_likelihood(np.zeros((1, 3, 3)), Prior(labels=6, right=4, wrong=2)))
    np.testing.assert_allclose(table[0], np.full((3, 3), 1 / 6) + np.eye(3) / 2)


def test_majority_credits_those_who_agree_with_what_won() -> None:
    labels = label_set(["a", "a", "a", "b", "b"], ["x", "y", "z", "x", "y"], ["no", "no", "yes", "yes", "no"])
    found = majority(labels)
    assert found.posterior.tolist() == [[2 / 3, 1 / 3], [1 / 2, 1 / 2]]
    np.testing.assert_allclose(found.reliability, [2.5 / 4, 2.5 / 4, 1 / 3])  # one right, one wrong added
    np.testing.assert_allclose(found.standard_error[2], np.sqrt(1 / 3 * 2 / 3 / 4))


def test_weighted_majority_lets_two_reliable_workers_outvote_three() -> None:
    rows = [
        (task, worker, label) for task in range(30) for worker, label in zip("abcde", "00123", strict=True)
    ]
    rows += [(99, worker, label) for worker, label in zip("abcde", "00111", strict=True)]
    labels = label_set([t for t, _, _ in rows], [w for _, w, _ in rows], [y for _, _, y in rows])
    assert majority(labels).posterior[-1].argmax() == 1
    assert weighted_majority(labels).posterior[-1].argmax() == 0


def test_a_tie_is_drawn_by_name_and_seed_or_left_open() -> None:
    posterior = np.array([[0.5, 0.5, 0.0]] * 60 + [[0.2, 0.3, 0.5]])
    names: list[Name] = [f"t{number}" for number in range(61)]
    drawn = decided(posterior, names, seed=0)
    assert drawn[60] == 2
    assert {15, 45} > {drawn[:60].count(0)} or 15 < drawn[:60].count(0) < 45
    assert drawn[:60].count(0) + drawn[:60].count(1) == 60
    assert decided(posterior[::-1], names[::-1], seed=0) == drawn[::-1]
    mirrored = decided(posterior[:, [1, 0, 2]], names, seed=1)
    assert mirrored != drawn
    assert decided(posterior, names, seed=None) == [None] * 60 + [2]
    assert decided(posterior, names, seed=0, abstain_below=0.6) == [None] * 61


def test_accuracy_counts_an_abstention_and_an_unheard_label_as_not_right() -> None:
    answers: dict[Name, Name | None] = {"a": "x", "b": None, "c": "y", "d": "x"}
    assert accuracy(answers, {"a": "x", "b": "x", "c": "z", "elsewhere": "x"}) == 1 / 3
    with pytest.raises(ParameterError, match="no task of the labels has a known truth"):
        accuracy(answers, {"elsewhere": "x"})


def test_names_become_indices_tasks_by_first_row_workers_and_classes_sorted() -> None:
    labels = label_set(["t9", "t1", "t9"], ["zed", "amy", "amy"], ["b", "a", "a"])
    assert labels.task_names == ["t9", "t1"]
    assert labels.worker_names == ["amy", "zed"]
    assert labels.class_names == ["a", "b"]
    assert [column.tolist() for column in labels.votes[:3]] == [[0, 1, 0], [1, 0, 0], [1, 0, 0]]
    assert labels.votes[3:] == (2, 2, 2)


@pytest.mark.parametrize("values", [[7, 3, 3, -2, 7], [10**15, -5, 10**15, 0, -5]])
def test_arrays_of_integers_are_read_as_lists_are(values: list[int]) -> None:
    names, ids = factorise(np.array(values))
    same, places = factorise(values)
    assert (names, ids.tolist()) == (same, places.tolist())


@pytest.mark.parametrize("method", NAMES)
def test_one_label_alone_and_one_class_alone_are_answered(method: str) -> None:
    alone = label_set(["t"], ["w"], ["yes"])
    found = aggregate(alone, method).outcome
    assert decided(found.posterior, alone.task_names, seed=0) == [0]
    assert alone.class_names == ["yes"]
    agreed = label_set(["t", "u", "u"], ["w", "w", "v"], ["yes", "yes", "yes"])
    found = aggregate(agreed, method).outcome
    assert decided(found.posterior, agreed.task_names, seed=0) == [0, 0]
    assert np.isfinite(found.reliability).all()
    assert np.isfinite(found.standard_error).all()


def test_a_prior_helps_where_workers_gave_few_labels_and_belongs_to_matrices_alone() -> None:
    columns = sparse_set(0)
    labels = label_set(columns.tasks, columns.workers, columns.labels)
    right = []
    for prior in (0.0, 1.0):
        classes = aggregate(labels, "dawid-skene", prior).outcome.posterior.argmax(axis=1).tolist()
        named = [labels.class_names[index] for index in classes]
        right.append(
            sum(columns.truth[task] == name for task, name in zip(labels.task_names, named, strict=True))
        )
    assert right[1] > right[0] + 5
    assert aggregate(labels, "online-dawid-skene", 5.0).live is not None
    with pytest.raises(ParameterError, match="one-coin has no prior in labels a class"):
        aggregate(labels, "one-coin", 1.0)
    for method in ("dawid-skene", "online-dawid-skene"):
        with pytest.raises(ParameterError, match=r"prior -1\.0 is outside"):
            aggregate(labels, method, -1.0)


def test_columns_of_unequal_length_and_empty_ones_are_refused() -> None:
    with pytest.raises(ParameterError, match="2 tasks, 1 workers, 2 labels"):
        label_set(["a", "b"], ["w"], ["x", "y"])
    with pytest.raises(ParameterError, match="holds no label"):
        label_set([], [], [])
    with pytest.raises(ParameterError, match="crowd method 'sorcery' is unknown"):
        aggregate(label_set(["t"], ["w"], ["yes"]), "sorcery")


@pytest.mark.parametrize("cap", [0.1, 0.25, 0.5, 0.9])
def test_after_the_cut_nobody_holds_more_than_the_cap_nor_less_than_a_newcomer(cap: float) -> None:
    chance = np.random.default_rng(0)
    newcomer = 1.8
    for _ in range(300):
        weights = (chance.standard_normal(int(chance.integers(1, 25))) * 3).tolist()
        limit = influence_limit(weights, newcomer, cap)
        assert limit >= newcomer
        sizes = [max(min(abs(weight), limit), newcomer) for weight in weights]
        if limit > newcomer:
            assert max(sizes) <= cap * sum(sizes) * (1 + 1e-9)
        if limit < max(abs(weight) for weight in weights):  # no more is cut than must be
            assert limit == newcomer or max(sizes) == pytest.approx(cap * sum(sizes))
