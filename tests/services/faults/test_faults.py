"""The share of continuous integration of each fault, with its counts (campaigns.py: the full numbers)."""

import shutil
import sys

import pytest

from tests.services.faults.campaigns import carry_out, named


@pytest.fixture
def holds(capsys: pytest.CaptureFixture[str]) -> "Holds":
    return Holds(capsys)


class Holds:
    """Carries out a campaign's share, prints its counts, and fails with what is not as promised."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, name: str) -> int:
        fault = named(name)
        outcome = carry_out(fault, fault.share)
        with self.capsys.disabled():
            sys.stdout.write(f"\n{name}: {outcome.tried}: {outcome.result}\n")
        assert outcome.broken == ()
        return outcome.tried


def test_a_power_cut_loses_no_acknowledged_label(holds: Holds) -> None:
    assert holds("power-cuts") == named("power-cuts").share


def test_a_flipped_bit_is_noticed_and_loses_nothing(holds: Holds) -> None:
    assert holds("bit-flips") == named("bit-flips").share


def test_a_file_cut_short_is_noticed_and_loses_nothing(holds: Holds) -> None:
    assert holds("cuts") == named("cuts").share


@pytest.mark.real
@pytest.mark.timeout(240)
def test_killed_processes_lose_nothing_and_count_nothing_twice(holds: Holds) -> None:
    assert holds("kills") >= named("kills").share


@pytest.mark.real
@pytest.mark.timeout(240)
@pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")
def test_a_learner_killed_in_a_sync_loses_nothing(holds: Holds) -> None:
    assert holds("sync-kills") == named("sync-kills").share


@pytest.mark.real
def test_a_learner_with_a_long_journal_acknowledges_again_soon(holds: Holds) -> None:
    assert holds("restart") == named("restart").share


@pytest.mark.real
def test_a_long_journal_is_proven_soon(holds: Holds) -> None:
    assert holds("verify") == named("verify").share


def test_random_frames_are_refused_and_cost_no_memory(holds: Holds) -> None:
    assert holds("random-frames") >= named("random-frames").share


def test_mutated_frames_are_messages_or_refused(holds: Holds) -> None:
    assert holds("mutated-frames") >= named("mutated-frames").share


def test_every_rule_holds_in_the_simulator(holds: Holds) -> None:
    assert holds("simulator") == named("simulator").share


def test_every_rule_holds_in_long_lessons_of_the_simulator(holds: Holds) -> None:
    assert holds("simulator-long") == named("simulator-long").share
