"""`sfid/Sokoban-v0` for everybody who speaks Gymnasium, and environments of other packages for us."""

import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from services.gym.registration import GROUP, register_environments
from services.gym.sokoban import GLYPHS
from services.gym.world import GymGround, described
from sfid_core.sokoban.levels import packaged

ID = "services.gym.registration:sfid/Sokoban-v0"


def made(**options: Any) -> Any:  # noqa: ANN401 - any option, and Gymnasium's wrapped environment
    return gymnasium.make(ID, **options)


@pytest.mark.parametrize("render_mode", [None, "ansi", "rgb_array"])
@pytest.mark.parametrize("starts", ["1", "4", "all", "within:3"])
def test_gymnasiums_own_checker_finds_nothing_to_say(render_mode: str | None, starts: str) -> None:
    check_env(made(render_mode=render_mode, starts=starts).unwrapped)


def test_another_process_makes_it_by_its_name_alone() -> None:
    script = f"import gymnasium; print(gymnasium.make({ID!r}).spec.id)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "sfid/Sokoban-v0\n"


def test_the_entry_point_names_the_function_that_registers_it() -> None:
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text(encoding="utf-8"))
    points = project["project"]["entry-points"][GROUP]
    assert {name: EntryPoint(name, text, GROUP).load() for name, text in points.items()} == {
        "sfid": register_environments
    }
    register_environments()
    register_environments()
    assert gymnasium.spec("sfid/Sokoban-v0").entry_point == "services.gym.sokoban:SokobanEnvironment"


def test_the_oracle_solves_every_start_in_the_fewest_steps() -> None:
    environment = made(starts="all")
    for seed in range(20):
        _, info = environment.reset(seed=seed)
        fewest, steps, total = info["optimal_steps"], 0, 0.0
        ended = cut = False
        while not (ended or cut):
            action = environment.unwrapped.optimal_actions()[0]
            assert info["action_mask"][action] == 1
            _, reward, ended, cut, info = environment.step(action)
            steps, total = steps + 1, total + reward
        assert (steps, total, info["outcome"], cut) == (fewest, 10.0, "solved", False)


def test_chance_is_the_seed_of_reset_and_nothing_else() -> None:
    first, second = made(starts="all"), made(starts="all")
    np.random.seed(1)  # noqa: NPY002 - the generator that it must not draw from
    ways = [first.reset(seed=5)[0], *(first.reset()[0] for _ in range(5))]
    np.random.seed(2)  # noqa: NPY002 - as above
    again = [second.reset(seed=5)[0], *(second.reset()[0] for _ in range(5))]
    assert all(np.array_equal(one, other) for one, other in zip(ways, again, strict=True))
    assert len({way.tobytes() for way in ways}) > 1


def test_a_deadlock_ends_an_episode_and_the_cap_cuts_it_off() -> None:
    lost = made(level="#######\n#  .  #\n# $@  #\n#     #\n#######", deadlock_reward=-3.0, step_reward=-1.0)
    lost.reset(seed=0)
    _, reward, ended, cut, info = lost.step(0)
    assert (reward, ended, cut) == (-4.0, True, False)
    assert (info["outcome"], info["optimal_steps"]) == ("deadlock", -1)
    capped = made(steps_max=3)
    capped.reset(seed=0)
    assert [capped.step(0)[2:4] for _ in range(3)] == [(False, False), (False, False), (False, True)]


def test_an_observation_is_the_level_cell_by_cell() -> None:
    observation, info = made().reset(seed=0)
    text = "\n".join("".join(GLYPHS[number] for number in row) for row in observation)
    assert text == packaged("room")[0].to_xsb()
    assert (observation.dtype, info["optimal_steps"]) == (np.uint8, 11)


def test_the_picture_is_the_projects_own_pixel_art() -> None:
    environment = made(render_mode="rgb_array")
    environment.reset(seed=0)
    before = environment.render()
    environment.step(2)
    assert (before.shape, before.dtype) == ((112, 112, 3), np.uint8)
    assert not np.array_equal(before, environment.render())
    ansi = made(render_mode="ansi")
    ansi.reset(seed=0)
    assert ansi.render() == packaged("room")[0].to_xsb()


def test_it_is_a_world_of_sessions_like_any_other_environment() -> None:
    world = described("sfid/Sokoban-v0", {"level": "room", "starts": "all"}, render="picture")
    assert (world.actions, world.steps_max) == (("LEFT", "RIGHT", "UP", "DOWN"), 200)
    assert GymGround(world, 1).begin(0).view.startswith("data:image/png;base64,")


def test_environments_of_installed_packages_are_found_by_their_entry_points(tmp_path: Path) -> None:
    """As MiniGrid's are, which stand in no namespace; a package that fails is passed over."""
    (tmp_path / "maze.py").write_text(
        "import gymnasium\n"
        "def register():\n"
        "    gymnasium.register('Maze-v0', entry_point='gymnasium.envs.toy_text.frozen_lake:FrozenLakeEnv')\n"
        "def broken():\n"
        "    raise RuntimeError('no maze')\n"
    )
    info = tmp_path / "maze-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: maze\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[gymnasium.envs]\n__root__ = maze:register\nlab = maze:register\nwrong = maze:broken\n"
    )
    script = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from services.gym.world import described\n"
        "print(described('Maze-v0', {}).environment, described('lab/Maze-v0', {}).environment)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout == "Maze-v0 lab/Maze-v0\n", done.stderr
    assert "maze:broken are not registered: no maze" in done.stderr
