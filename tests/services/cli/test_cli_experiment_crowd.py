"""`sfid experiment crowd` as a person runs it."""

import json
from pathlib import Path

import pytest

from tests.services.cli.command_line import sfid


def test_crowds_are_compared_with_and_without_random_members_and_a_second_run_takes_up_the_first(
    tmp_path: Path,
) -> None:
    pytest.importorskip("matplotlib")
    run = ("experiment", "crowd", "--mix", "good:7,random:3", "--mix", "expert:1", "--seeds", "10",
           "--workers", "1", "--json")  # fmt: skip
    done = sfid(*run, "--out", str(tmp_path / "out"))
    assert done.code == 0, done.stderr
    told = json.loads(done.stdout)
    assert [(one["mix"], one["random_share"]) for one in told["crowds"]] == [
        ("good:7,random:3", 0.3),
        ("good:7", 0.0),
        ("expert:1", 0.0),
    ]
    assert told["crowds"][2]["accuracy"] == [1.0, 1.0, 1.0]
    (claim,) = told["claims"]
    assert claim["claim"].startswith("good:7 solves at most 5 points fewer starts with 30% random members")
    assert (claim["seeds"], claim["margin"]) == (10, 0.05)
    names = {Path(path).name for path in told["files"]}
    assert names == {
        "seeds.csv", "seeds.parquet", "claims.csv", "claims.parquet", "codebook.md", "codebook.json",
        "crowd.png", "crowd.svg", "crowd.rrd",
    }  # fmt: skip
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "chunks").glob("*.npy")}
    again = json.loads(sfid(*run, "--out", str(tmp_path / "out")).stdout)
    assert (again["sha256"], again["claims"]) == (told["sha256"], told["claims"])
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert len(kept) == 3


def test_a_mix_that_cannot_be_read_is_refused_with_the_mend() -> None:
    done = sfid("experiment", "crowd", "--mix", "wise:3")
    assert done.code == 2
    assert "mix 'wise:3' is not KIND:COUNT" in done.stderr
