"""The study behind the page: its file, its book that outlives every crash, and the flow over both."""

import json
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from protocol.messages import CreateSession
from services.cli.main import app
from services.cli.shared.failure import CommandError
from services.cli.shared.level_files import find_level
from services.cli.study import load
from services.operator import OperatorError
from services.runtime.clock import ManualClock
from services.runtime.journal import verify
from services.screens import FINISHED, FlowRefusal, Person
from services.study.book import Book, study_folder
from services.study.definition_file import read_study, template
from services.study.flow import StudyFlow
from services.study.reading import read_courses
from services.study.sessions import Sessions, session_config
from sfid_core.study.definition import Recruiter, Study
from sfid_core.study.effort import SCALES
from sfid_core.study.errors import StudyError
from tests.services.study.participants import study_file

ANN = Person("p-ann", "maze", "t1")
BOB = Person("p-bob", "maze", "t2")
RATINGS = {scale.name: 20.0 for scale in SCALES}


class FakeSessions:
    """Notes what is wished for."""

    def __init__(self) -> None:
        self.wishes: list[tuple[str, str]] = []

    def create(self, config: CreateSession) -> None:
        self.wishes.append(("create", config.session))

    def stop(self, session: str) -> None:
        self.wishes.append(("stop", session))

    def hold(self, session: str, *, on: bool) -> None:
        self.wishes.append(("pause" if on else "resume", session))


def study_of(folder: Path, change: Callable[[str], str] = str, **fields: Any) -> Study:  # noqa: ANN401
    path = study_file(folder, **fields)
    path.write_text(change(path.read_text()))
    return read_study(path, find_level).study


def opened(folder: Path, **fields: Any) -> tuple[StudyFlow, Book, FakeSessions]:  # noqa: ANN401
    sessions = FakeSessions()
    book = Book.open(study_of(folder, **fields), folder / "data", ManualClock(wall_ns=7))
    return StudyFlow(book, sessions), book, sessions  # type: ignore[arg-type]


def test_the_template_is_a_whole_study_but_for_whom_participants_can_ask(tmp_path: Path) -> None:
    path = tmp_path / "My Study.toml"
    result = CliRunner().invoke(app, ["study", "new", str(path)])
    assert result.exit_code == 0, result.output
    found = read_study(path, find_level)
    assert (found.study.name, [one.method for one in found.study.conditions]) == (
        "my-study",
        ["sfid", "reward"],
    )
    assert found.study.practice is not None
    assert found.unfinished in found.study.consent.text
    with pytest.raises(CommandError, match="say whom participants can ask"):
        CliRunner().invoke(app, ["study", "run", str(path)], catch_exceptions=False)
    path.write_text(path.read_text().replace(found.unfinished, "Ann Example, room 7"))
    assert read_study(path, find_level).unfinished == ""
    assert all(len(line) <= 110 for line in template("x").splitlines())
    with pytest.raises(Exception, match="exists: name another"):
        CliRunner().invoke(app, ["study", "new", str(path)], catch_exceptions=False)


def test_a_level_that_is_not_there_is_told_with_the_file_that_names_it(tmp_path: Path) -> None:
    path = tmp_path / "maze.toml"
    CliRunner().invoke(app, ["study", "new", str(path)])
    path.write_text(path.read_text().replace('level = "room"', 'level = "rooom"'))
    with pytest.raises(CommandError, match=f"^{path}: no level 'rooom'"):
        load(path)


@pytest.mark.parametrize(
    "before, after, said",
    [
        ('method = "sfid"', 'method = "sfids"', "unknown method 'sfids'"),
        (
            'design = "between"',
            'design = "mixed"',
            "design 'mixed' is unknown: choose one of between, within",
        ),
        ('name = "maze"', 'name = "Maze!"', r"name: give text in quotes like"),
        (
            "episodes = 3",
            'episodes = "many"',
            "teaching, episodes: text in quotes where a whole number belongs: change it",
        ),
        (
            "[practice]",
            "[practise]",
            "unknown key practise: correct its name, or take it out; `sfid study new`",
        ),
        ('version = "1"', 'version = ""', "consent, version: give text in quotes of length >= 1"),
        ('name = "rewards"', 'name = "labels"', "give each a name of its own"),
        ("seed = 1", "seed = ", "not TOML"),
    ],
)
def test_a_file_that_makes_no_sense_is_refused_in_one_line(
    tmp_path: Path, before: str, after: str, said: str
) -> None:
    with pytest.raises(StudyError, match=said) as refused:
        study_of(tmp_path, lambda text: text.replace(before, after))
    assert str(refused.value).startswith(f"{tmp_path}/maze.toml: ")
    assert "\n" not in str(refused.value)


def test_a_new_life_of_the_page_goes_on_where_everybody_was(tmp_path: Path) -> None:
    """After each step the book is closed and opened anew, as after a crash."""
    values: dict[str, dict[str, Any]] = {"agree": {"agreed": True}, "send": dict(RATINGS)}
    presses = ["agree", "go", FINISHED, "go", FINISHED, "send"]
    seen, after = [], None
    for press in presses:
        flow, book, sessions = opened(tmp_path)
        flow.arrive(ANN, {})
        screen = flow.screen(ANN)
        seen.append(screen.name)
        assert bool(sessions.wishes) is (screen.session is not None)
        flow.submit(ANN, screen.name, press, values.get(press, {}))
        after = flow.screen(ANN)
        book.close()
        again, book, _ = opened(tmp_path)
        again.arrive(ANN, {})
        assert again.screen(ANN) == after
        book.close()
    assert seen == ["consent", "practice-intro", "practice", "intro-1", "teach-1", "effort-1"]
    assert after is not None
    assert after.name == "done"
    assert verify(study_folder(tmp_path / "data", "maze")).ok


def test_each_person_has_a_session_of_their_own_by_their_condition(tmp_path: Path) -> None:
    flow, book, _ = opened(tmp_path)
    methods: dict[str, str] = {}
    seeds: set[int] = set()
    for person in (ANN, BOB):
        flow.arrive(person, {})
        flow.submit(person, "consent", "agree", {"agreed": True})
        config = session_config(book.study, book.progress(person.pseudonym), person.pseudonym, 1)
        methods[config.session] = config.method
        seeds.add(config.seed)
    assert methods.keys() == {"maze-p-ann-1", "maze-p-bob-1"}
    assert set(methods.values()) == {"sfid", "reward"}
    assert len(seeds) == 1  # people of a block meet the same world
    book.close()


def test_a_consent_text_that_changes_without_a_new_version_is_refused(tmp_path: Path) -> None:
    opened(tmp_path)[1].close()
    changed = study_of(tmp_path, lambda text: text.replace("First.", "Other."))
    with pytest.raises(StudyError, match="version is still 1: give the new text a new version"):
        Book.open(changed, tmp_path / "data", ManualClock())
    newer = study_of(
        tmp_path, lambda text: text.replace("First.", "Other.").replace('version = "1"', 'version = "2"')
    )
    Book.open(newer, tmp_path / "data", ManualClock()).close()


def test_conditions_cannot_change_once_people_have_come(tmp_path: Path) -> None:
    change = 'method = "tamer"'
    flow, book, _ = opened(tmp_path)
    book.close()
    other = study_of(tmp_path, lambda text: text.replace('method = "reward"', change))
    Book.open(other, tmp_path / "data", ManualClock()).close()  # nobody has come
    flow, book, _ = opened(tmp_path)
    flow.arrive(ANN, {})
    book.close()
    with pytest.raises(StudyError, match="conditions changed since people took part"):
        Book.open(other, tmp_path / "data", ManualClock())


def test_a_lesson_against_the_clock_waits_for_who_is_away_or_hesitates(tmp_path: Path) -> None:
    folder = tmp_path
    study = study_of(folder, lambda text: text.replace("[teaching]", '[teaching]\nwindow = "full"'))
    sessions = FakeSessions()
    book = Book.open(study, folder / "data", ManualClock())
    flow = StudyFlow(book, sessions)  # type: ignore[arg-type]
    flow.arrive(ANN, {})
    flow.submit(ANN, "consent", "agree", {"agreed": True})
    flow.submit(ANN, "practice-intro", "go", {})
    flow.depart(ANN)
    assert sessions.wishes == [("create", "maze-p-ann-0")]  # practice waits for every answer anyway
    flow.submit(ANN, "practice", FINISHED, {})
    flow.submit(ANN, "intro-1", "go", {})
    del sessions.wishes[:]
    flow.depart(ANN)
    flow.arrive(ANN, {})
    flow.submit(ANN, "teach-1", "stop", {})
    flow.submit(ANN, "stop", "go-on", {})
    flow.submit(ANN, "teach-1", "stop", {})
    flow.submit(ANN, "stop", "stop-keep", {})
    name, create = "maze-p-ann-1", ("create", "maze-p-ann-1")
    assert sessions.wishes == [
        ("pause", name), create, ("resume", name), create, ("pause", name), create, ("resume", name),
        create, ("pause", name), ("stop", name),
    ]  # fmt: skip
    flow.depart(BOB)  # somebody who was never taken in
    book.close()


def test_what_cannot_be_saved_does_not_count_and_the_same_press_counts_later(tmp_path: Path) -> None:
    ids = {"workerId": "W1", "assignmentId": "A1", "hitId": "H1"}
    flow, book, _ = opened(tmp_path, recruiter="mturk")
    flow.arrive(ANN, ids)
    book.close()
    with pytest.raises(FlowRefusal, match="press it again"):
        flow.submit(ANN, "consent", "agree", {"agreed": True})
    assert flow.screen(ANN).name == "consent"
    flow, book, _ = opened(tmp_path, recruiter="mturk")
    flow.arrive(ANN, ids)
    flow.submit(ANN, "consent", "agree", {"agreed": True})
    assert flow.screen(ANN).name == "practice-intro"
    book.close()


def test_mturk_previews_are_turned_away_and_its_parameters_kept(tmp_path: Path) -> None:
    flow, book, _ = opened(tmp_path, recruiter="mturk")
    ids = {"workerId": "W1", "assignmentId": "A1", "hitId": "H1"}
    with pytest.raises(FlowRefusal, match="accept the HIT"):
        flow.arrive(ANN, ids | {"assignmentId": "ASSIGNMENT_ID_NOT_AVAILABLE"})
    unfilled = {name: f"{{{name}}}" for name in ids}  # as `run` prints the link
    with pytest.raises(FlowRefusal, match=r"\(workerId\)"):
        flow.arrive(ANN, unfilled)
    with pytest.raises(FlowRefusal, match=r"\(workerId\)"):
        flow.arrive(ANN, ids | {"workerId": "no id!"})
    flow.arrive(ANN, ids)
    flow.submit(ANN, "consent", "agree", {"agreed": True})
    assert dict(book.people.of(ANN.pseudonym)) == ids
    assert book.study.recruiter is Recruiter.MTURK
    book.close()


def test_a_link_for_something_else_is_refused(tmp_path: Path) -> None:
    flow, book, _ = opened(tmp_path)
    with pytest.raises(FlowRefusal, match="open the link of the study"):
        flow.arrive(Person("p-eve", "other", "t3"), {})
    book.close()


def test_what_a_learner_refuses_is_asked_again_and_others_are_served_meanwhile() -> None:
    class Refusing:
        def __init__(self) -> None:
            self.asked: list[str] = []
            self.done = threading.Event()

        def create(self, config: Any) -> None:  # noqa: ANN401 - a name is enough here
            self.asked.append(config.session)
            if self.asked.count("a") < 2 and config.session == "a":
                raise OperatorError("the learner is busy")
            if {"a", "b"} <= set(self.asked) and self.asked.count("a") == 2:
                self.done.set()

    operator = Refusing()
    sessions = Sessions(operator)  # type: ignore[arg-type]
    for name in ("a", "b", "a"):
        sessions.create(json_config(name))
    assert operator.done.wait(10)
    sessions.close()
    assert sorted(operator.asked) == ["a", "a", "b"]


def json_config(name: str) -> Any:  # noqa: ANN401 - stands for a CreateSession
    return SimpleNamespace(session=name)


def test_status_without_data_says_how_to_begin(tmp_path: Path) -> None:
    result = CliRunner().invoke(
        app, ["study", "status", str(study_file(tmp_path)), "--data", str(tmp_path), "--json"]
    )
    assert result.exit_code == 1
    assert not json.dumps(result.stdout).strip('"')


def test_an_event_is_on_the_disk_before_the_next_screen_is_shown(tmp_path: Path) -> None:
    flow, book, _ = opened(tmp_path, recruiter="prolific", code="C1")
    flow.arrive(ANN, {"PROLIFIC_PID": "x1"})
    assert read_courses(tmp_path / "data", "maze")[1].keys() == {ANN.pseudonym}
    flow.submit(ANN, "consent", "agree", {"agreed": True})
    (course,) = read_courses(tmp_path / "data", "maze")[1].values()
    assert (course.progress.number, course.progress.code) == (0, book.progress(ANN.pseudonym).code)
    folder = study_folder(tmp_path / "data", "maze")
    assert "x1" in (folder / "people.json").read_text()
    flow.submit(ANN, "practice-intro", "stop", {})
    flow.submit(ANN, "stop", "stop-delete", {})
    assert json.loads((folder / "people.json").read_text()) == {}
    book.close()


def test_nobody_s_identity_is_kept_before_they_agree_or_when_they_decline(tmp_path: Path) -> None:
    flow, book, _ = opened(tmp_path, recruiter="mturk")
    ids = {"workerId": "W1", "assignmentId": "A1", "hitId": "H1"}
    kept = study_folder(tmp_path / "data", "maze") / "people.json"
    flow.arrive(ANN, ids)
    flow.arrive(BOB, ids)  # the same worker in two browsers, neither of whom has agreed
    assert not kept.exists()
    flow.submit(ANN, "consent", "decline", {})
    assert not kept.exists()
    flow.submit(BOB, "consent", "agree", {"agreed": True})
    assert json.loads(kept.read_text()) == {BOB.pseudonym: ids}
    book.close()


def test_of_two_browsers_of_one_person_the_first_to_agree_takes_part(tmp_path: Path) -> None:
    flow, book, _ = opened(tmp_path, recruiter="mturk")
    ids = {"workerId": "W1", "assignmentId": "A1", "hitId": "H1"}
    for person in (ANN, BOB):
        flow.arrive(person, ids)
    flow.submit(ANN, "consent", "agree", {"agreed": True})
    with pytest.raises(FlowRefusal, match="begun in another browser"):
        flow.submit(BOB, "consent", "agree", {"agreed": True})
    assert flow.screen(BOB).name == "consent"
    flow.depart(ANN)
    flow.arrive(ANN, {})  # a link without them is enough for who is known
    assert flow.screen(ANN).name == "practice-intro"
    flow.depart(BOB)
    flow.arrive(BOB, {})
    with pytest.raises(FlowRefusal, match="says not who you are"):
        flow.submit(BOB, "consent", "agree", {"agreed": True})
    book.close()
