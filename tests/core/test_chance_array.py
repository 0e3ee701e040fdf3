"""Many draws at once are the draws of one at a time."""

import numpy as np
import pytest

from sfid_core.chance import below, draw, stream, unit
from sfid_core.chance_array import belows, draws, streams, units

COUNTERS = [*range(50), 2**32 - 1, 2**32, 2**53, 2**63 + 1, 2**64 - 2]


@pytest.mark.parametrize("key", [0, 1, 1234567, stream(7, "statistics"), 2**64 - 1])
def test_an_array_of_draws_is_bit_for_bit_the_single_draws(key: int) -> None:
    counters = np.array(COUNTERS, dtype=np.uint64)
    assert draws(key, counters).tolist() == [draw(key, counter) for counter in COUNTERS]
    assert units(key, counters).tolist() == [unit(key, counter) for counter in COUNTERS]


@pytest.mark.parametrize("n", [1, 2, 3, 1000, 2**31 + 1, 2**32])
def test_an_array_of_bounded_draws_is_the_single_draws(n: int) -> None:
    assert belows(99, range(500), n).tolist() == [below(99, counter, n) for counter in range(500)]


def test_the_streams_of_many_seeds_are_those_of_one_seed_at_a_time() -> None:
    seeds = [0, 7, -3, 2**63, 12345678901234567]
    assert streams(seeds, "start", 4).tolist() == [stream(seed, "start", 4) for seed in seeds]
    assert streams(seeds).tolist() == [stream(seed) for seed in seeds]
    assert streams([], "start").shape == (0,)


def test_keys_and_counters_broadcast() -> None:
    keys = np.array([[3], [2**64 - 5]], dtype=np.uint64)
    assert draws(keys, [0, 1, 9]).tolist() == [[draw(int(key), c) for c in (0, 1, 9)] for key in keys[:, 0]]


def test_one_counter_gives_one_draw_without_a_warning() -> None:
    single = draws(2**64 - 1, 5)
    assert single.shape == ()
    assert int(single) == draw(2**64 - 1, 5)
    assert draws(1, []).shape == (0,)
