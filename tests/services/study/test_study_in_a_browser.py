"""A participant in a real Chromium walks a whole study with mouse and keys, reloading on the way (ring 3)."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from services.cli.shared.level_files import find_level
from services.study.definition_file import read_study
from services.study.reading import read_participants
from sfid_core.study.assignment import order_of
from sfid_core.study.flow import Standing
from tests.browser.chromium import Tab, chromium, program
from tests.services.study.participants import Running, running, study_file

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(program() is None, reason="no Chromium is installed"),
]
TITLE = "document.querySelector('.form h1')?.innerText"
ASKS = "document.querySelector('.teach.open') !== null"


@pytest.fixture(scope="module")
def maze(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A study whose first participant says labels: in its corridor, right is always the way."""
    folder = tmp_path_factory.mktemp("browser")
    study = read_study(study_file(folder), find_level).study
    seed = next(seed for seed in range(20) if order_of(replace(study, seed=seed), 0) == (0,))
    with running(study_file(folder, seed=seed, episodes=2), folder / "data") as started:
        yield started


def press(tab: Tab, button: str) -> None:
    tab.wait(f"document.querySelector('[data-button={button}]:not(:disabled)') !== null")
    tab.click(f"[data-button={button}]")


def at(tab: Tab, title: str) -> None:
    tab.wait(f"{TITLE} === '{title}'")


def teach_right(tab: Tab, then: str) -> None:
    """Say RIGHT to whatever is asked until a page with that title comes.

    With another key each time: the same one again at once is a key held down.
    """
    for turn in range(400):
        tab.wait(f"{ASKS} || {TITLE} === '{then}'")
        if tab.run(f"{TITLE} === '{then}'"):
            return
        tab.key(("ArrowRight", "l", "d")[turn % 3])
    raise AssertionError("the lesson has no end")


def rate(tab: Tab) -> None:
    for name, presses in (("mental", 2), ("physical", 1), ("temporal", 3), ("performance", 1), ("effort", 2)):
        tab.run(f"document.querySelector('#field-{name}').focus()")
        for _ in range(presses):
            tab.key("ArrowRight")


def test_the_whole_way_in_a_browser(maze: Running, tmp_path: Path) -> None:
    with chromium() as browser:
        tab = browser.tab(browser.person(), dark=False)
        tab.open(maze.link)
        at(tab, "Teach an agent")
        press(tab, "agree")
        assert "still missing" in tab.text("#problem")
        tab.click("#field-agreed")
        press(tab, "agree")
        at(tab, "Practice")
        press(tab, "go")
        teach_right(tab, "Your lesson")
        tab.reload()
        at(tab, "Your lesson")
        press(tab, "go")
        tab.wait(ASKS)
        tab.key("ArrowRight")
        tab.reload()
        tab.wait(ASKS)
        press(tab, "stop")
        at(tab, "Stop taking part?")
        press(tab, "go-on")
        teach_right(tab, "How much effort was it?")
        rate(tab)
        press(tab, "send")
        assert tab.text("#problem") == "One answer is still missing."
        tab.key("ArrowRight")  # the slider that was left out has the focus
        press(tab, "send")
        at(tab, "Thank you!")
        code = tab.text(".code code")
        tab.reload()
        at(tab, "Thank you!")
        assert tab.text(".code code") == code
        assert tab.complaints() == []
        tab.close()
    (one,) = read_participants(maze.data, "maze")[1]
    assert (one.standing, one.code) == (Standing.COMPLETED, code)
    assert one.ratings == {1: (60, 55, 65, 55, 60, 55)}
    assert one.lessons[1].is_whole
