"""The clocks: one of the system, one moved by hand."""

import pytest

from services.runtime.clock import Clock, ManualClock, SystemClock


def test_a_manual_clock_stands_still_until_it_is_advanced() -> None:
    clock: Clock = (manual := ManualClock(now_ns=5, wall_ns=1_000))
    assert (clock.now_ns(), clock.wall_ns(), clock.now_ns()) == (5, 1_000, 5)
    manual.advance(7)
    assert (clock.now_ns(), clock.wall_ns()) == (12, 1_007)


def test_a_manual_clock_does_not_go_back() -> None:
    clock = ManualClock()
    with pytest.raises(ValueError, match="span_ns = -1"):
        clock.advance(-1)
    assert clock.now_ns() == 0


def test_the_system_clock_never_goes_back_and_shows_this_century() -> None:
    clock: Clock = SystemClock()
    times = [clock.now_ns() for _ in range(1000)]
    assert times == sorted(times)
    assert clock.wall_ns() > 1_700_000_000 * 10**9
