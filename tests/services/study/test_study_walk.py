"""Participants walk through a running study: router, environment, learner and page as processes (ring 3)."""

import json
import stat
from collections.abc import Iterator

import pytest
from typer.testing import CliRunner

from services.cli.main import app
from services.study.reading import read_courses, read_participants
from sfid_core.study.assignment import order_of
from sfid_core.study.flow import Standing
from tests.services.study.participants import Running, running, study_file

pytestmark = pytest.mark.real
RATINGS = (60, 5, 40, 20, 55, 0)
WAY = ["consent", "practice-intro", "practice", "intro-1", "teach-1", "effort-1", "done"]


@pytest.fixture(scope="module")
def maze(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("study")
    with running(study_file(folder), folder / "data") as started:
        yield started


@pytest.fixture(scope="module")
def prolific(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("prolific")
    with running(study_file(folder, recruiter="prolific", code="C1AB2CD3"), folder / "data") as started:
        yield started


def test_a_participant_walks_the_whole_way_reloading_at_each_step(maze: Running) -> None:
    ann = maze.participant(1)
    assert ann.screen["text"] == ["First.", "Second."]
    assert (ann.open(), ann.agree()) == ("consent", "practice-intro")
    assert (ann.open(), ann.press("go")) == ("practice-intro", "practice")
    ann.teach(answers_max=1)
    assert (ann.open(), ann.teach()) == ("practice", "intro-1")
    assert (ann.open(), ann.press("go")) == ("intro-1", "teach-1")
    session = ann.screen["session"]
    ann.teach(answers_max=1)
    assert (ann.open(), ann.screen["session"], ann.teach()) == ("teach-1", session, "effort-1")
    assert (ann.open(), ann.rate(*RATINGS)) == ("effort-1", "done")
    code = ann.screen["code"]
    assert (len(code), ann.open(), ann.screen["code"]) == (8, "done", code)
    assert list(dict.fromkeys(ann.seen)) == WAY
    study, people = read_participants(maze.data, "maze")
    one = next(person for person in people if person.pseudonym == ann.pseudonym)
    assert (one.standing, one.ratings, one.code) == (Standing.COMPLETED, {1: RATINGS}, code)
    assert one.consent == ("1", study.consent.sha256)
    assert one.conditions == (study.conditions[order_of(study, one.number)[0]].name,)
    lesson = one.lessons[1]
    assert (len(lesson.episodes), lesson.is_whole) == (3, True)
    assert lesson.answers >= sum(episode.inputs for episode in lesson.episodes) > 0


def test_a_step_is_neither_skipped_nor_done_twice(maze: Running) -> None:
    bob = maze.participant(2)
    bob.send("go", screen="intro-1")
    assert bob.look() == "consent"
    bob.send("agree")  # without the box that has to be ticked
    assert bob.refused().startswith("something is missing")
    bob.send("agree", agreed=True)
    bob.send("agree", agreed=True, screen="consent")
    assert (bob.look(), bob.look()) == ("practice-intro", "practice-intro")
    bob.send("send", screen="effort-1", **dict.fromkeys(("mental", "effort"), 5))
    assert bob.look() == "practice-intro"
    _, people = read_courses(maze.data, "maze")
    assert [step for step, _ in people[bob.pseudonym].times] == ["consent"]


def test_who_stops_in_the_middle_of_a_lesson_may_keep_or_delete_what_was_answered(maze: Running) -> None:
    keep, drop = maze.participant(3), maze.participant(4)
    for person in (keep, drop):
        person.agree()
        assert person.press("go") == "practice"
        person.teach(answers_max=1)
        assert person.press("stop") == "stop"
        assert (person.open(), person.press("go-on")) == ("stop", "practice")
        assert person.press("stop") == "stop"
    assert keep.press("stop-keep") == "withdrawn"
    assert drop.press("stop-delete") == "erased"
    assert (keep.open(), drop.open()) == ("withdrawn", "erased")
    _, people = read_participants(maze.data, "maze")
    standing = {person.pseudonym: person.standing for person in people}
    assert standing[keep.pseudonym] is Standing.WITHDRAWN
    assert drop.pseudonym not in standing
    status = CliRunner().invoke(app, ["study", "status", str(maze.file), "--data", str(maze.data), "--json"])
    assert json.loads(status.stdout)["to_erase"] == [drop.pseudonym]


def test_who_declines_sees_no_lesson(maze: Running) -> None:
    eve = maze.participant(5)
    assert eve.press("decline") == "declined"
    assert eve.open() == "declined"
    eve.send("agree", screen="consent", agreed=True)
    assert eve.look() == "declined"


def test_prolific_people_are_kept_apart_from_answers_and_take_part_once(prolific: Running) -> None:
    assert "PROLIFIC_PID={{%PROLIFIC_PID%}}" in prolific.link
    ids = {"PROLIFIC_PID": "5f9c1", "STUDY_ID": "66aa", "SESSION_ID": "77bb"}
    ann = prolific.participant(1, **ids, utm_source="mail")
    ann.agree()
    folder = prolific.data / "study-maze"
    assert json.loads((folder / "people.json").read_text()) == {ann.pseudonym: ids}
    assert stat.S_IMODE((folder / "people.json").stat().st_mode) == 0o600
    kept = [
        path.read_bytes() for path in prolific.data.rglob("*") if path.is_file() and "people" not in path.name
    ]
    assert not any(value.encode() in content for content in kept for value in ids.values())
    assert prolific.participant(2, **ids).refused() == (
        "you have begun in another browser: go on there, everybody takes part once"
    )
    assert prolific.participant(3, STUDY_ID="66aa").refused().startswith("the link says not who you are")
    other = prolific.participant(1, **(ids | {"PROLIFIC_PID": "other"}))
    assert other.refused().startswith("somebody else takes part in this browser")
    assert ann.open() == "practice-intro"
    assert ann.press("stop") == "stop"
    assert ann.press("stop-delete") == "erased"
    assert json.loads((folder / "people.json").read_text()) == {}


def test_within_people_each_lesson_asks_as_its_condition_says(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = tmp_path_factory.mktemp("within")
    with running(study_file(folder, design="within", episodes=1), folder / "data") as both:
        orders = []
        for number in (1, 2):
            ann = both.participant(number)
            ann.agree()
            ann.press("go")
            ann.teach()
            asked: list[str] = []
            for lesson in (1, 2):
                assert ann.screen["name"] == f"intro-{lesson}"
                ann.asked.clear()
                ann.press("go")
                assert ann.teach() == f"effort-{lesson}"
                asked += ann.asked
                ann.rate(*RATINGS)
            assert ann.screen["name"] == "done"
            orders.append(asked)
        _, people = read_participants(both.data, "maze")
    assert sorted(orders) == [["label", "reward"], ["reward", "label"]]
    assert [one.conditions for one in people] == [
        tuple({"label": "labels", "reward": "rewards"}[asked] for asked in order) for order in orders
    ]
    assert all(one.ratings == {1: RATINGS, 2: RATINGS} and len(one.lessons) == 2 for one in people)
