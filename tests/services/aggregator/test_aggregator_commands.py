"""The aggregator's commands: what cannot be is said in one line, before a router is waited for."""

from pathlib import Path

import pytest

from tests.services.cli.command_line import sfid

pytestmark = pytest.mark.real


@pytest.mark.parametrize(
    "flags,line",
    [
        (("--method", "best"), "crowd method 'best' is unknown: choose one of majority, weighted,"),
        (("--gold-share", "3"), "gold_share 3.0 is outside [0, 1]: 0.1 is usual"),
        (("--quorum", "-1"), "quorum -1 is negative: use 0 for everybody present, or a number"),
        (("--crowd-deployment", "local"), "deployment 'local' is the learner's: give the crowd another"),
        (("--name", "The Crowd"), "aggregator name 'The Crowd' is not allowed: "),
        (("--connect", "nowhere"), "endpoint"),
    ],
)  # fmt: skip
def test_an_aggregator_that_cannot_be_is_refused_in_one_line(
    tmp_path: Path, flags: tuple[str, ...], line: str
) -> None:
    done = sfid("aggregate", "--data", str(tmp_path), *flags)
    assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert line in done.stderr


@pytest.mark.parametrize(
    "flags,line",
    [
        (
            ("--mix", "best:3"),
            "mix 'best:3' is not KIND:COUNT or KIND@ACCURACY:COUNT: kinds are expert, good",
        ),
        (("--workers", "3"), "the mix has 20 workers, --workers says 3: leave --workers out or mend one"),
        (("--dropout-rate", "2"), "dropout_rate 2.0 is outside [0, 1]: 0 is never"),
    ],
)
def test_a_crowd_that_cannot_be_is_refused_in_one_line(flags: tuple[str, ...], line: str) -> None:
    done = sfid("teach", "crowd", "--session", "s1", *flags)
    assert (done.code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert line in done.stderr


def test_who_said_what_needs_a_journal(tmp_path: Path) -> None:
    done = sfid("said", str(tmp_path), "--session", "s1")
    assert (done.code, done.stderr.count("\n")) == (2, 1)
