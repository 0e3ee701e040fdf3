"""Somebody at the page, somebody at a terminal and a script teach one agent as a crowd (ring 3)."""

import json
import shutil
import sys
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.browser.chromium import Tab, chromium, program
from tests.services.aggregator.crowd_up import crowd_up
from tests.services.cli.command_line import running, sfid, wait_for
from tests.services.teachers.terminal import Terminal

pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(program() is None, reason="no Chromium is installed"),
    pytest.mark.skipif(shutil.which("tmux") is None, reason="tmux is not installed"),
]
DECISIONS = 5
PRESSES = 20
MEMBERS = {"page", "script", "terminal"}
SHOWN = "document.querySelector('.teach')?.dataset.shown"
FATE = "document.querySelector('.fate').dataset.state"


@pytest.fixture
def endpoint(tmp_path: Path) -> Iterator[str]:
    with crowd_up(tmp_path) as endpoint:
        yield endpoint


def test_a_page_a_terminal_and_a_script_teach_as_a_crowd_and_who_said_what_is_told(
    endpoint: str, tmp_path: Path
) -> None:
    _done("session", "create", "s1", "--connect", endpoint, "--window-mode", "until-answered")
    member = ("--session", "s1", "--deployment", "local-crowd", "--connect", endpoint, "--name")
    link = _done("invite", "--session", "s1", "--name", "page", "--data", str(tmp_path), "--json")["url"]
    keyboard = [sys.executable, "-m", "services.cli.main", "teach", "keyboard", *member, "terminal"]
    with ExitStack() as stack:
        terminal = Terminal(tmp_path / "tmux", [*keyboard, "--outbox", str(tmp_path / "outbox")])
        stack.callback(terminal.end)
        stack.enter_context(running("teach", "scripted", *member, "script", stderr=tmp_path / "script.log"))
        browser = stack.enter_context(chromium())
        tab = browser.tab(browser.person())
        tab.open(link)
        terminal.wait_for(r"step \d+ ")
        wait_for("the script takes part", lambda: " ready" in (tmp_path / "script.log").read_text())
        for _ in range(DECISIONS):
            _teach_once(tab, terminal)
    said = _done("said", str(tmp_path), "--session", "s1", "--json")["said"]
    crowd = [row for row in said if row["via"] == "crowd"]
    together = [
        number
        for number in {row["decision"] for row in crowd}
        if {row["teacher"] for row in crowd if row["decision"] == number} == MEMBERS
    ]
    assert len(together) >= DECISIONS - 1, crowd  # the last may still be open
    assert {row["teacher"] for row in said if not row["via"]} == {"crowd"}
    for row in crowd:
        assert row["asked_at_ns"] <= row["shown_ns"][1] <= row["arrived_at_ns"]
        assert row["shown_ns"][0] <= row["answered_ns"][1]


def _teach_once(tab: Tab, terminal: Terminal) -> None:
    """Answer the open decision at the page and at the terminal, and wait for the next."""
    before = tab.wait(SHOWN)
    tab.key("ArrowUp")
    tab.wait(f"{FATE} !== 'none'")
    changed = f"({SHOWN} ?? {json.dumps(before)}) !== {json.dumps(before)}"
    for _ in range(PRESSES):  # a key pressed in the very moment a decision appears is dropped
        terminal.press("w")
        with suppress(AssertionError):
            tab.wait(changed, 0.5)
            return
    pytest.fail(f"the decision stays open:\n{terminal.screen()}")


def _done(*arguments: str) -> dict[str, Any]:
    done = sfid(*arguments)
    assert done.code == 0, done.stderr
    return dict(json.loads(done.stdout)) if "--json" in arguments else {}
