"""A Gymnasium environment behind the environment service: begun, walked, taken back, restored, refused."""

import re
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import pytest
from gymnasium.error import DependencyNotInstalled

from protocol.messages import GymWorld
from protocol.translate import action_names
from protocol.world_messages import UNDO
from services.cli.shared.failure import CommandError
from services.cli.shared.gym_options import gym_world
from services.environment import Environment
from services.gym.errors import GymError
from services.gym.world import GymGround, described
from tests.services.gym.lakes import CLIFF, DRY_LAKE, ICE, TAXI, begun, executed, refused, walked

SHORTEST = ("DOWN", "DOWN", "RIGHT", "RIGHT", "DOWN", "RIGHT")


class Counter(gymnasium.Env[int, int]):
    """Counts up or stays; draws itself as nine pixels; chance and picture are the test's to choose."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as Gymnasium wants it

    def __init__(self, render_mode: str | None = None, *, fails: bool = False, wide: int = 3) -> None:
        self.action_space: Any = gymnasium.spaces.Discrete(2, start=5)
        self.observation_space: Any = gymnasium.spaces.Discrete(100)
        self.render_mode, self.fails, self.wide = render_mode, fails, wide
        self.at = 0

    def reset(self, *, seed: int | None = None, options: object = None) -> tuple[int, dict[str, Any]]:
        super().reset(seed=seed)
        self.at = int(self.np_random.integers(10))
        return self.at, {}

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        if self.fails:
            raise RuntimeError("the counter\nis broken")
        self.at += (action - 5) * int(self.np_random.integers(1, 3))
        return self.at, 0.5, self.at >= 20, False, {}

    def render(self) -> npt.NDArray[np.uint8]:
        return np.full((3, self.wide, 3), self.at, np.uint8)


@pytest.fixture(autouse=True)
def _registered() -> Iterator[None]:
    gymnasium.register("Counter-v0", entry_point=Counter)  # type: ignore[arg-type]
    yield
    del gymnasium.registry["Counter-v0"]


def test_an_environment_describes_itself_as_a_world() -> None:
    assert DRY_LAKE.environment == "FrozenLake-v1"
    assert DRY_LAKE.level_name == "FrozenLake-v1 (is_slippery=False)"
    assert DRY_LAKE.actions == ("LEFT", "DOWN", "RIGHT", "UP")
    assert (DRY_LAKE.goal_reward, DRY_LAKE.step_reward, DRY_LAKE.steps_max) == (1.0, 0.0, 100)
    assert TAXI.actions == ("DOWN", "UP", "RIGHT", "LEFT", "PICKUP", "DROPOFF")
    assert (TAXI.goal_reward, TAXI.step_reward, TAXI.steps_max) == (20.0, -1.0, 200)
    assert (CLIFF.actions, CLIFF.steps_max) == (("UP", "RIGHT", "DOWN", "LEFT"), 200)
    assert described("Counter-v0", {}).actions == ("ACTION_0", "ACTION_1")
    assert described("Counter-v0", {}).goal_reward is None
    assert described("Counter-v0", {}, actions=("STAY", "UP")).actions == ("STAY", "UP")
    assert described("Taxi-v4", {}, reward_scale=0.1).goal_reward == pytest.approx(2.0)


def test_a_lake_is_walked_to_its_goal_with_the_steps_that_are_left() -> None:
    environment = Environment()
    start = begun(environment, DRY_LAKE)
    replies = walked(environment, DRY_LAKE, SHORTEST)
    assert (start.optimal_steps, start.actions) == (6, action_names(DRY_LAKE))
    assert [reply.optimal_steps for reply in replies] == [5, 4, 3, 2, 1, None]
    assert [(reply.reward, reply.outcome) for reply in replies] == [(0.0, "running")] * 5 + [(1.0, "solved")]
    assert start.view == "[S] F  F  F\n F  H  F  H\n F  F  F  H\n H  F  F  G"
    assert replies[1].view == " S  F  F  F\n F  H  F  H\n[F] F  F  H\n H  F  F  G"


def test_a_hole_ends_the_episode_without_success() -> None:
    last = walked(Environment(), DRY_LAKE, ("DOWN", "RIGHT"))[-1]
    assert (last.outcome, last.reward, last.optimal_steps) == ("failed", 0.0, None)


def test_the_end_of_the_cliff_is_its_goal_although_it_costs_a_step() -> None:
    replies = walked(Environment(), CLIFF, ("UP", *("RIGHT",) * 11, "DOWN"))
    assert [reply.outcome for reply in replies] == ["running"] * 12 + ["solved"]
    fallen = walked(Environment(), CLIFF, ("RIGHT",))[0]
    assert (fallen.outcome, fallen.reward, fallen.optimal_steps) == ("running", -100.0, 13)


def test_rewards_are_scaled_and_nothing_else() -> None:
    scaled = described("FrozenLake-v1", {"is_slippery": False}, reward_scale=10.0)
    assert walked(Environment(), scaled, SHORTEST)[-1].reward == 10.0
    assert [reply.state for reply in walked(Environment(), scaled, SHORTEST)] == [
        reply.state for reply in walked(Environment(), DRY_LAKE, SHORTEST)
    ]


def test_the_environments_own_cap_is_the_sessions_and_cuts_off() -> None:
    replies = walked(Environment(), DRY_LAKE, ("LEFT",) * 100)
    assert [reply.outcome for reply in replies[98:]] == ["running", "cap"]


@pytest.mark.parametrize("world", [ICE, TAXI, DRY_LAKE], ids=lambda world: str(world.level_name))
def test_an_environment_that_forgot_restores_an_episode_from_its_seed_and_actions(world: GymWorld) -> None:
    actions = ("DOWN", "RIGHT", "UP", "LEFT", "RIGHT", "DOWN", "LEFT", "UP")
    environment = Environment()
    at: Any = begun(environment, world, episode=3)
    taken: list[str] = []
    for number, action in enumerate(actions):
        if getattr(at, "outcome", "running") != "running":
            break
        again = begun(Environment(), world, episode=3, actions=tuple(taken))
        assert (again.state, again.view, again.step) == (at.state, at.view, number)
        at = executed(environment, at, number, action, episode=3)
        taken.append(action)
    assert len(taken) > 1


def test_chance_on_the_ice_differs_from_episode_to_episode_and_is_the_same_for_a_seed() -> None:
    def ways() -> list[list[bytes]]:
        found = []
        for episode in range(8):
            environment = Environment()
            at: Any = begun(environment, ICE, episode=episode)
            found.append([at.state])
            for number in range(3):
                if getattr(at, "outcome", "running") == "running":
                    at = executed(environment, at, number, "RIGHT", episode=episode)
                    found[-1].append(at.state)
        return found

    first = ways()
    assert first == ways()
    assert len({tuple(way) for way in first}) > 3


def test_episodes_begin_from_as_many_resets_as_are_asked_for() -> None:
    def starts(text: str) -> list[bytes]:
        world = described("Taxi-v4", {}, starts=text)
        return [begun(Environment(), world, episode=number).state for number in range(8)]

    assert len(set(starts("1"))) == 1
    four = starts("4")
    assert four[:4] == four[4:]
    assert len(set(four)) == 4
    assert len(set(starts("all"))) > 5


def test_undo_goes_back_and_an_undone_undo_forward_again() -> None:
    environment = Environment()
    start = begun(environment, DRY_LAKE)
    moved = executed(environment, start, 0, "DOWN")
    back = executed(environment, moved, 1, UNDO)
    assert (back.state, back.view, back.reward, back.outcome) == (start.state, start.view, 0.0, "running")
    forward = executed(environment, back, 2, UNDO)
    assert forward.state == moved.state
    again = begun(Environment(), DRY_LAKE, actions=("DOWN", UNDO, UNDO))
    assert (again.state, again.step) == (moved.state, 3)


def test_undo_on_the_ice_takes_back_what_chance_did() -> None:
    environment = Environment()
    at: Any = begun(environment, ICE)
    first = executed(environment, at, 0, "RIGHT")
    back = executed(environment, first, 1, UNDO)
    assert executed(environment, back, 2, "RIGHT").state == first.state


def test_sessions_share_the_table_and_never_the_episode() -> None:
    ground = GymGround(TAXI, 7)
    one, two = ground.begin(0), ground.begin(0)
    one.act("DOWN", 0)
    assert one.state != two.state
    assert one._environment.unwrapped.P is two._environment.unwrapped.P  # noqa: SLF001 - memory has no other witness
    held = one._environment  # noqa: SLF001 - as above
    one.close()
    one.close()
    assert ground.begin(1)._environment is held  # noqa: SLF001 - as above
    assert ground.begin(1)._environment is not held  # noqa: SLF001 - as above


def test_an_environment_without_a_table_is_taught_by_people_and_drawn_as_a_picture() -> None:
    world = described("Counter-v0", {}, render="picture", actions=("STAY", "UP"))
    ground = GymGround(world, 7)
    course = ground.begin(0)
    assert (ground.optimal, course.start_steps) == ({}, None)
    assert course.view.startswith("data:image/png;base64,iVBORw0KGgo")
    before = course.view
    assert course.act("UP", 0)[0] == 0.5
    assert course.view != before


@pytest.mark.parametrize(
    "changes, reason",
    [
        ({"environment": "Lake-v9"}, "environment Lake-v9: "),
        (
            {"options": {"fails": True}, "environment": "Counter-v0", "actions": ("A", "B", "C")},
            "has 2 actions",
        ),
        ({"options": {"render_mode": "human"}}, "option render_mode of FrozenLake-v1 is not yours to set"),
        ({"options": {"bottomless": True}}, "environment FrozenLake-v1: "),
    ],
)
def test_a_world_that_cannot_be_made_is_refused_in_one_line(changes: dict[str, Any], reason: str) -> None:
    refusal = refused(DRY_LAKE, changes)
    assert refusal.code == "invalid"
    assert reason in refusal.reason
    assert "\n" not in refusal.reason


def test_an_environment_that_fails_on_the_way_is_one_line() -> None:
    course = GymGround(described("Counter-v0", {"fails": True}), 7).begin(0)
    with pytest.raises(GymError, match=r"^environment Counter-v0: the counter is broken$"):
        course.act("ACTION_1", 0)
    with pytest.raises(GymError, match=r"^no action JUMP: use one of ACTION_0, ACTION_1$"):
        course.act("JUMP", 0)


@pytest.mark.parametrize(
    "environment, options, reason",
    [
        ("os:system", {}, "name a registered one"),
        ("CartPole-v1", {}, "states it can meet again"),
        ("Pendulum-v1", {}, "discrete actions"),
        ("FrozenLake-v1", {"map_name": None}, "another one each time it is made"),
        ("Taxi-v3", {}, "Taxi-v4"),
    ],
)
def test_an_environment_that_cannot_be_taught_is_told_before_a_session_is_made(
    environment: str, options: dict[str, Any], reason: str
) -> None:
    with pytest.raises(GymError, match=reason):
        described(environment, options)


@pytest.mark.parametrize(
    "name, mend",
    [
        ("FrozenLke-v1", "did you mean FrozenLake-v1 or FrozenLake8x8-v1?"),
        ("frozenlake", "did you mean FrozenLake-v1 or FrozenLake8x8-v1?"),
        ("FrozenLake8x8-v9", "did you mean FrozenLake8x8-v1 or FrozenLake-v1?"),
        ("Taxi", "did you mean Taxi-v4?"),
        ("sokoban", "did you mean sfid/Sokoban-v0?"),
        ("Qqq-v0", "install the package it comes with, or mend its name"),
    ],
)
def test_a_name_that_is_mistyped_is_told_with_those_that_are_like_it(name: str, mend: str) -> None:
    with pytest.raises(GymError) as failure:
        described(name, {})
    assert str(failure.value) == f"environment {name}: no environment has this name: {mend}"


class Undrawable(Counter):
    """Needs a package for its picture, as FrozenLake does where pygame is missing."""

    metadata: dict[str, Any] = {"render_modes": ["ansi", "rgb_array"]}  # noqa: RUF012 - as Gymnasium wants it

    def render(self) -> Any:  # noqa: ANN401 - as Gymnasium wants it
        raise DependencyNotInstalled('paint is not installed, run `pip install "gymnasium[toy-text]"`')


@pytest.mark.parametrize("render, mend", [("picture", ", or leave --gym-render picture out"), ("text", "")])
def test_a_picture_that_needs_a_missing_package_is_refused_with_how_to_install_it(
    render: str, mend: str
) -> None:
    gymnasium.register("Undrawable-v0", entry_point=Undrawable)  # type: ignore[arg-type]
    try:
        with pytest.raises(GymError) as failure:
            described("Undrawable-v0", {}, render=render)
    finally:
        del gymnasium.registry["Undrawable-v0"]
    assert str(failure.value) == (
        "environment Undrawable-v0: it cannot be drawn: paint is not installed, "
        f"run `pip install 'gymnasium[toy-text]'`{mend}"
    )


@pytest.mark.skipif(find_spec("pygame") is not None, reason="pygame is installed here")
@pytest.mark.parametrize("name", ["FrozenLake-v1", "Taxi-v4"])
def test_the_picture_of_a_toy_world_without_pygame_is_refused_before_its_session_is_made(name: str) -> None:
    with pytest.raises(CommandError) as failure:
        gym_world(name, None, None, "picture")
    said = r"cannot be drawn: pygame is not installed, run `pip install 'gymnasium\[toy-text\]'`, or leave "
    assert re.search(said, str(failure.value))
    assert failure.value.exit_code == 2


class Map(Counter):
    """Cannot draw itself, and writes its map when asked, as MiniGrid's do."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium wants it

    def pprint_grid(self) -> str:
        return f"WG{self.at:02d}\nWGGG"


def test_an_environment_that_cannot_draw_itself_is_seen_by_its_map_or_by_what_it_observes() -> None:
    gymnasium.register("Map-v0", entry_point=Map)  # type: ignore[arg-type]
    try:
        course = GymGround(described("Map-v0", {}), 7).begin(0)
        assert course.view.splitlines()[1] == "WGGG"
        assert course.view.startswith("WG0")
    finally:
        del gymnasium.registry["Map-v0"]
    assert GymGround(described("Blackjack-v1", {}), 7).begin(0).view.startswith("(")


def test_minigrid_is_a_world_where_it_is_installed() -> None:
    pytest.importorskip("minigrid")
    world = described("MiniGrid-Empty-5x5-v0", {}, starts="1")
    assert world.actions == ("LEFT", "RIGHT", "FORWARD", "PICKUP", "DROP", "TOGGLE", "DONE")
    replies = walked(Environment(), world, ("FORWARD", "FORWARD", "RIGHT", "FORWARD", "FORWARD"))
    assert replies[-1].outcome == "solved"
    assert replies[0].view.splitlines()[0] == "WG" * 5
    picture = described("MiniGrid-Empty-5x5-v0", {}, render="picture")
    assert GymGround(picture, 1).begin(0).view.startswith("data:image/png;base64,")
