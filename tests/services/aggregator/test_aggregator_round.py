from pathlib import Path
from collections.abc import Iterator
import pytest
from tests.services.aggregator.crowd_room import CrowdRoom, EARLY
from tests.services.learner.classroom import session


@pytest.fixture
def room(tmp_path: Path) -> Iterator[CrowdRoom]:
    made = CrowdRoom(tmp_path / "data")
    yield made
    made.close()


def test_a_crowd_agrees_and_the_learner_gets_one_answer_with_its_posterior(room: CrowdRoom) -> None:
    room.create(session())
    ann, bob, cat = room.members("ann", "bob", "cat")
    assert room.present() == ("crowd",)
    codes = [ann.label("UP"), bob.label("UP"), cat.label("LEFT")]
    assert codes == ["accepted"] * 3
    answers = room.learner_answers()
    assert [(a.teacher, a.kind, a.action) for a in answers] == [("crowd", "label", "UP")]
    assert room.decision.decision == 1
    print(answers, room.reports)
