import re

import pytest

from sfid_core.learning.parameters import ParameterError
from sfid_core.teaching.crowd_mix import WorkerKind, WorkerSpec, mind_of, parse_mix

STATES = [number.to_bytes(16, "little") for number in range(2000)]


def share_right(spec: WorkerSpec) -> float:
    mind = mind_of(spec, 7, "s1")
    labels = [mind.label(number, state, (2,)) for number, state in enumerate(STATES)]
    return sum(label == 2 for label in labels) / len(labels)


def test_a_mix_names_its_workers() -> None:
    assert parse_mix("good:2, random:1,adversary@0.1:1") == (
        WorkerSpec("w-good-1", WorkerKind.GOOD, 0.8),
        WorkerSpec("w-good-2", WorkerKind.GOOD, 0.8),
        WorkerSpec("w-random-1", WorkerKind.RANDOM, 0.0),
        WorkerSpec("w-adversary-1", WorkerKind.ADVERSARY, 0.1),
    )


def test_a_kind_that_is_named_twice_goes_on_counting() -> None:
    names = [worker.name for worker in parse_mix("good@0.9:2,good@0.6:2", "x")]
    assert names == ["x-good-1", "x-good-2", "x-good-3", "x-good-4"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "good",
        "good:",
        "good:-1",
        "best:3",
        "good@2:1",
        "good@x:1",
        "random@0.5:1",
        "good:0",
        "good:99999",
    ],
)
def test_a_mix_that_cannot_be_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ParameterError, match=r"^mix ") as caught:
        parse_mix(text)
    assert re.fullmatch(r"[^\n]{10,250}", str(caught.value))


@pytest.mark.parametrize(
    "mix,low,high",
    [("expert:1", 1.0, 1.0), ("good:1", 0.77, 0.83), ("careless:1", 0.56, 0.64), ("random:1", 0.22, 0.28),
     ("adversary:1", 0.0, 0.0), ("good@0.95:1", 0.93, 0.97)],
)  # fmt: skip
def test_workers_are_as_reliable_as_their_kind(mix: str, low: float, high: float) -> None:
    assert low <= share_right(parse_mix(mix)[0]) <= high


def test_a_constant_worker_names_one_action() -> None:
    mind = mind_of(parse_mix("constant:1")[0], 7, "s1")
    assert len({mind.label(number, state, (2,)) for number, state in enumerate(STATES)}) == 1


def test_two_workers_of_a_kind_err_apart_and_the_same_seed_says_the_same() -> None:
    one, other = parse_mix("random:2")
    said = [
        [mind_of(spec, 7, "s1").label(number, state, (2,)) for number, state in enumerate(STATES)]
        for spec in (one, other, one)
    ]
    assert said[0] == said[2]
    assert 0.2 < sum(a == b for a, b in zip(said[0], said[1], strict=True)) / len(STATES) < 0.3


@pytest.mark.parametrize("mix", ["random:1", "constant:40", "adversary:1", "good@0.2:1"])
def test_in_a_world_of_six_actions_all_six_are_named(mix: str) -> None:
    minds = [mind_of(spec, 7, "s1", 6) for spec in parse_mix(mix)]
    said = {mind.label(number, state, (2,)) for mind in minds for number, state in enumerate(STATES)}
    assert said - {2} == {0, 1, 3, 4, 5}


def test_who_does_not_look_praises_as_often_as_blames() -> None:
    mind = mind_of(parse_mix("random:1")[0], 7, "s1")
    rewards = [mind.reward(number, state, 2, (2,)) for number, state in enumerate(STATES)]
    assert set(rewards) == {1.0, -1.0}
    assert abs(sum(reward or 0.0 for reward in rewards)) < 150
