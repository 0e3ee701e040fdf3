"""A person at a terminal: real services, a real terminal, keys pressed one by one, the screen read back."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.keys import Keys
from protocol.messages import CreateSession, WindowSpec, World
from services.cli.shared import launch
from services.operator import Operator
from services.replay import replay_directory
from services.router import free_endpoint
from services.runtime.signals import Stop
from services.topology import Role
from sfid_core.sokoban.actions import Action
from sfid_core.sokoban.levels import packaged, parse_levels
from sfid_core.sokoban.solver import solve
from tests.services.teachers.terminal import Terminal

CELLS = {"██": "#", "  ": " ", "@@": "@", "(@": "+", "[]": "$", "()": ".", "{}": "*"}
KEYS = {Action.LEFT: "Left", Action.RIGHT: "l", Action.UP: "w", Action.DOWN: "Down"}
"""One of each set of keys that the screen offers: arrows, hjkl, wasd."""


@pytest.fixture
def deployed(tmp_path: Path) -> Iterator[launch.Deployed]:
    """Yield a running router, environment and learner."""
    found = launch.Deployed(tmp_path / "data", free_endpoint(), "tmux")
    supervisor = launch.supervise(found.data, launch.make_directories(found.data), Stop())
    try:
        supervisor.start(launch.router(found))
        supervisor.start(launch.environment(found), launch.learner(found))
        yield found
    finally:
        supervisor.stop()


def board_on(screen: str) -> str:
    """Return the level that the screen draws, in XSB."""
    rows = [line for line in screen.splitlines() if line.startswith("  ██")]
    width = len(packaged("room")[0].to_xsb().splitlines()[0])
    return "\n".join(
        "".join(CELLS[row[2 + 2 * cell : 4 + 2 * cell]] for cell in range(width)) for row in rows
    )


@pytest.mark.skipif(shutil.which("tmux") is None, reason="tmux is not installed")
def test_a_person_teaches_a_whole_episode_with_the_keyboard(
    deployed: launch.Deployed, tmp_path: Path
) -> None:
    level = packaged("room")[0]
    solution = solve(level)
    bus = launch.bus(deployed, Role.OPERATOR)
    operator = Operator(bus, Keys(deployed.deployment))
    window = WindowSpec(mode="until-answered", span_ms=2_000)
    world = World(level=level.to_xsb(), level_name="room", starts="within:2")
    operator.create(CreateSession(session="maze", world=world, episodes=1, window=window, seed=3))
    command = [
        sys.executable,
        "-m",
        "services.cli.main",
        "teach",
        "keyboard",
        "--session",
        "maze",
        "--name",
        "ann",
    ]
    command += ["--connect", deployed.endpoint, "--deployment", deployed.deployment]
    terminal = Terminal(tmp_path / "tmux", [*command, "--outbox", str(tmp_path / "outbox")])
    try:
        answered, key = 0, None
        while True:
            screen = terminal.wait_for(rf"step {answered + 1} |finished", key)
            if "finished" in screen:
                break
            if len(board_on(screen).splitlines()) < level.height:
                continue  # caught while it was being drawn
            board = parse_levels(board_on(screen))[0].start
            key = KEYS[solution.optimal_actions(board)[0]]
            terminal.press(key)
            answered += 1
        terminal.press("q")
        report, (episode,) = operator.show("maze")
    finally:
        terminal.end()
        bus.close()
    assert episode.steps == episode.inputs == answered
    assert (report.labels.submitted, report.labels.acknowledged, report.labels.applied) == (answered,) * 3
    (replayed,) = replay_directory(deployed.data)
    assert replayed.q_sha256 == report.q_sha256
