"""Processes of a running study are killed: its people go on where they were (ring 3)."""

import json
import os
import signal
import socket
import threading
import time
from pathlib import Path

import pytest
from websockets.exceptions import WebSocketException

from services.runtime.journal import read_rows
from services.study.erasure import erasures
from services.study.reading import read_participants
from sfid_core.study.flow import Standing
from tests.services.study.participants import Participant, running, study_file

pytestmark = pytest.mark.real
BACK_S = 60.0
RATINGS = (60, 5, 40, 20, 55, 0)


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def kill(data: Path, role: str) -> None:
    processes = {row["role"]: row["pid"] for row in json.loads((data / "processes.json").read_text())}
    os.kill(processes[role], signal.SIGKILL)


def come_back(person: Participant) -> str:
    """Open the page again, as a browser does by itself, until there is one."""
    until = time.monotonic() + BACK_S
    pause = threading.Event()
    while True:
        try:
            return person.open()
        except (OSError, WebSocketException):
            assert time.monotonic() < until
            pause.wait(0.1)


def test_a_participant_outlives_the_death_of_the_page_and_of_the_learner(tmp_path: Path) -> None:
    with running(study_file(tmp_path), tmp_path / "data", listen=f"127.0.0.1:{free_port()}") as maze:
        ann = maze.participant(1)
        ann.agree()
        kill(maze.data, "gateway")
        assert come_back(ann) == "practice-intro"
        assert ann.press("go") == "practice"
        assert ann.teach() == "intro-1"
        assert ann.press("go") == "teach-1"
        ann.teach(answers_max=2)
        kill(maze.data, "gateway")
        assert come_back(ann) == "teach-1"
        ann.teach(answers_max=1)
        kill(maze.data, "learner")
        assert ann.teach() == "effort-1"
        kill(maze.data, "gateway")
        assert come_back(ann) == "effort-1"
        assert ann.rate(*RATINGS) == "done"
        (one,) = read_participants(maze.data, "maze")[1]
    assert (one.standing, one.ratings) == (Standing.COMPLETED, {1: RATINGS})
    assert (len(one.lessons[1].episodes), one.lessons[1].is_whole) == (3, True)


def test_a_study_that_is_started_again_has_the_same_link_and_its_people(tmp_path: Path) -> None:
    file, data, listen = study_file(tmp_path), tmp_path / "data", f"127.0.0.1:{free_port()}"
    with running(file, data, listen) as maze:
        link, ann = maze.link, maze.participant(1)
        ann.agree()
        assert ann.press("go") == "practice"
        ann.teach(answers_max=1)
    with running(file, data, listen) as maze:
        assert maze.link == link
        ann.study = maze
        assert (ann.open(), ann.teach()) == ("practice", "intro-1")
        bob = maze.participant(2)
        assert (bob.agree(), bob.pseudonym != ann.pseudonym) == ("practice-intro", True)
        bob.press("stop")
        bob.press("stop-delete")
    assert [(left.data.name, left.session, left.person) for left in erasures(data, "maze")] == [
        ("study-maze", "maze", bob.pseudonym)
    ]


def test_whose_answers_are_to_be_erased_is_told_with_every_session_of_theirs(tmp_path: Path) -> None:
    with running(study_file(tmp_path), tmp_path / "data") as maze:
        ann = maze.participant(1)
        ann.agree()
        ann.press("go")
        ann.teach(answers_max=1)
        assert ann.press("stop") == "stop"
        assert erasures(maze.data, "maze") == ()
        assert ann.press("stop-delete") == "erased"
        left = {(one.data.name, one.session) for one in erasures(maze.data, "maze")}
    assert left == {("study-maze", "maze"), ("data", f"maze-{ann.pseudonym}-0")}


def rows_of(data: Path, session: str) -> list[str]:
    return [row.kind for row in read_rows(data, session)]


def await_row(data: Path, session: str, kind: str) -> list[str]:
    """Return the session's kinds of rows as soon as there is one of this kind."""
    until, pause = time.monotonic() + BACK_S, threading.Event()
    while kind not in (kinds := rows_of(data, session)):
        assert time.monotonic() < until, kinds
        pause.wait(0.1)
    return kinds


def test_a_lesson_against_the_clock_stands_still_while_nobody_is_there(tmp_path: Path) -> None:
    timed = 'window = "full"\nwindow_ms = 300'
    with running(study_file(tmp_path, episodes=1, extra=timed), tmp_path / "data") as maze:
        ann = maze.participant(1)
        ann.agree()
        ann.press("go")
        ann.teach()
        ann.press("go")
        ann.teach(answers_max=1)
        session = ann.screen["session"]
        ann.close()
        away = await_row(maze.data, session, "paused")
        assert rows_of(maze.data, session) == away
        assert ann.open() == "teach-1"
        await_row(maze.data, session, "resumed")
        assert ann.teach() == "effort-1"
        (one,) = read_participants(maze.data, "maze")[1]
    assert one.lessons[1].is_whole
