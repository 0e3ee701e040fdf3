"""The packed log of finished episodes gives back what was put in."""

from dataclasses import replace

import pytest

from sfid_core.outcome import Outcome
from sfid_core.session.episodes import Ended, EpisodeLog
from sfid_core.session.measures import EpisodeMeasures


def measures(episode: int, **changes: object) -> EpisodeMeasures:
    plain = EpisodeMeasures(episode, 17, 9, 0.1, 1 / 3, -2.5e-300, 10.0, 5, 4, Outcome.SOLVED)
    return replace(plain, **changes)  # type: ignore[arg-type]


EPISODES = (
    Ended(1_700_000_000_000_000_000, 17, measures(0)),
    Ended(1_700_000_000_000_000_001, 18, measures(1, steps=1, optimal_steps=None, outcome=Outcome.DEADLOCK)),
    Ended(2**63 - 1, 2**40, measures(2, steps=1_000_000, inputs=2**32 - 1, outcome=Outcome.CAP)),
    Ended(-1, 2**40, measures(3, optimal_steps=0, inputs=0, agreements=0, discounted_return=float("inf"))),
)


def logged(*episodes: Ended) -> EpisodeLog:
    log = EpisodeLog()
    for at_ns, decision, each in episodes:
        log.append(at_ns, decision, each)
    return log


def test_a_log_gives_back_every_episode_bit_for_bit() -> None:
    log = logged(*EPISODES)
    assert log.ended(0, 100) == EPISODES
    assert (tuple(log), len(log)) == (tuple(each.measures for each in EPISODES), 4)
    assert (log[0], log[-1]) == (EPISODES[0].measures, EPISODES[3].measures)


def test_a_log_gives_a_page_and_nothing_beyond_its_end() -> None:
    log = logged(*EPISODES)
    assert (log.ended(1, 2), log.ended(3, 2), log.ended(4, 2)) == (EPISODES[1:3], EPISODES[3:], ())
    for number in (4, -5):
        with pytest.raises(IndexError, match=f"episode {number} of 4"):
            log[number]


def test_two_logs_are_equal_when_they_tell_the_same_and_ended_at_the_same_times() -> None:
    assert logged(*EPISODES) == logged(*EPISODES)
    assert logged(*EPISODES) != logged(*EPISODES[:3])
    assert logged(EPISODES[0]) != logged(EPISODES[0]._replace(at_ns=5))
    assert logged() != ()
