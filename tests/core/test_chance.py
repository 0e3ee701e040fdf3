"""Draws by name and number: the generator against its published outputs, and what keys keep apart."""

from collections import Counter

import pytest

from sfid_core.chance import below, draw, stream, unit


@pytest.mark.parametrize(
    "seed, outputs",
    [
        (0, [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]),
        (1234567, [6457827717110365317, 3203168211198807973, 9817491932198370423]),
    ],
)
def test_draws_are_those_of_splitmix64(seed: int, outputs: list[int]) -> None:
    """The known first outputs of the generator of Steele, Lea & Flood under these seeds."""
    assert [draw(seed, counter) for counter in range(3)] == outputs


def test_a_stream_is_named_by_all_of_its_parts_in_their_order() -> None:
    keys = [
        stream(1, "teacher", "ann", "lab"),
        stream(2, "teacher", "ann", "lab"),
        stream(1, "teacher", "bob", "lab"),
        stream(1, "teacher", "lab", "ann"),
        stream(1, "teacher", "annlab"),
        stream(1, "teacher", "ann", "la", "b"),
        stream(1, "learner", "ann", "lab"),
        stream(1),
    ]
    assert len(set(keys)) == len(keys)
    assert all(0 <= key < 2**64 for key in keys)


def test_a_stream_is_the_same_on_every_machine() -> None:
    """A journal of another machine, or of next year, replays only while these stay."""
    assert stream(7, "learner", "lab") == 17768518642946019941
    assert [below(stream(7, "learner", "lab"), decision, 4) for decision in range(8)] == [
        1,
        0,
        2,
        2,
        2,
        3,
        2,
        2,
    ]


@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 64])
def test_below_is_uniform_over_its_range(n: int) -> None:
    draws = 4000 * n
    counts = Counter(below(stream(3, "uniform", n), counter, n) for counter in range(draws))
    assert set(counts) == set(range(n))
    assert all(abs(count - 4000) < 6 * 4000**0.5 for count in counts.values())


def test_below_stays_below_at_the_largest_range() -> None:
    assert all(0 <= below(5, counter, 2**32) < 2**32 for counter in range(1000))


def test_unit_is_uniform_in_zero_to_one() -> None:
    draws = [unit(stream(4, "unit"), counter) for counter in range(20_000)]
    assert min(draws) >= 0
    assert max(draws) < 1
    assert abs(sum(draws) / len(draws) - 0.5) < 0.01
    assert abs(sum(each < 0.1 for each in draws) / len(draws) - 0.1) < 0.01
