"""Participants walk through a running study: router, environment, learner and page as processes (ring 3)."""

from collections.abc import Iterator

import pytest

from services.study.reading import read_participants
from sfid_core.study.flow import Standing
from tests.services.study.participants import Running, running, study_file

pytestmark = pytest.mark.real
RATINGS = (60, 5, 40, 20, 55, 0)


@pytest.fixture(scope="module")
def maze(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("study")
    with running(study_file(folder), folder / "data") as started:
        yield started


def test_a_participant_walks_the_whole_way_and_each_step_is_in_the_data(maze: Running) -> None:
    ann = maze.participant(1)
    assert ann.screen["text"] == ["First.", "Second."]
    assert ann.agree() == "practice-intro"
    assert ann.press("go") == "practice"
    assert ann.teach() == "intro-1"
    assert ann.press("go") == "teach-1"
    assert ann.teach() == "effort-1"
    assert ann.rate(*RATINGS) == "done"
    assert len(ann.screen["code"]) == 8
    study, people = read_participants(maze.data, "maze")
    one = next(person for person in people if person.pseudonym == ann.pseudonym)
    assert (one.standing, one.ratings, one.code) == (Standing.COMPLETED, {1: RATINGS}, ann.screen["code"])
    assert one.consent == ("1", study.consent.sha256)
    assert len(one.lessons[1].episodes) == 3
    assert one.lessons[1].is_whole
    assert one.lessons[1].answers >= sum(episode.inputs for episode in one.lessons[1].episodes) > 0
    assert maze.participant(1).screen["name"] == "done"
