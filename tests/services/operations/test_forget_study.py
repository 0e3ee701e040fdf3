"""Whoever had their answers deleted in a study is forgotten there and in their lessons, and nobody else."""

import json
from pathlib import Path

import pytest

from services.replay import replay_directory
from services.runtime.journal import read_rows, verify
from services.study.erasure import erasures
from services.study.reading import read_courses
from tests.services.cli.command_line import sfid
from tests.services.operations.test_forget import holding
from tests.services.study.participants import running, study_file

pytestmark = pytest.mark.real


def test_the_deleted_of_a_study_are_forgotten_and_the_others_stay(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with running(study_file(tmp_path), data) as maze:
        ann, bob = maze.participant(1), maze.participant(2)
        for one in (ann, bob):
            one.agree()
            one.press("go")
            one.teach(answers_max=1)
        ann.press("stop")
        assert ann.press("stop-delete") == "erased"
    kept = [row for row in read_rows(data) if row.session.startswith(f"maze-{bob.pseudonym}")]
    assert erasures(data, "maze") != ()
    done = sfid("forget", str(data), "--study", "--json")
    (person,) = json.loads(done.stdout)["people"]
    assert (done.code, person["person"], person["answers"]) == (0, ann.pseudonym, 1)
    assert person["study_rows"] > 0
    assert erasures(data, "maze") == ()
    assert set(read_courses(data, "maze")[1]) == {bob.pseudonym}
    assert [row for row in read_rows(data) if row.session.startswith(f"maze-{bob.pseudonym}")] == kept
    told = [row for row in read_rows(data) if row.person == ann.pseudonym]
    assert told == []
    assert holding(data, ann.pseudonym.encode()) == []
    study = (data / "study-maze" / "shard-0" / "journal.sqlite").read_bytes()
    mirror = (data / "study-maze" / "shard-0" / "journal.mirror").read_bytes()
    assert ann.pseudonym.encode() not in study + mirror
    assert (verify(data).ok, verify(data / "study-maze").ok) == (True, True)
    assert all(one.matches for one in replay_directory(data))
