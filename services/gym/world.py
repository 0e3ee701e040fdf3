"""A Gymnasium environment as the world of a session: begun by seed, restored and taken back by its actions.

An episode is what its seed and its actions make of a fresh reset, chance included, so nothing is kept of it.
"""

import re
import warnings
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from difflib import get_close_matches
from functools import cached_property
from inspect import Parameter, signature
from typing import Any

import numpy as np

from protocol.messages import GymWorld
from protocol.world_messages import UNDO
from services.gym.digest import state_key
from services.gym.errors import GymError
from services.gym.names import action_names
from services.gym.oracle import Transitions, optimal_actions, table_of
from services.gym.rendering import VIEW_MAX, as_observed, as_picture, as_text
from sfid_core.chance import stream
from sfid_core.outcome import Outcome

STEPS_MAX = 200
"""Cap of an episode where the environment has none."""
RESERVED = frozenset({"id", "render_mode", "max_episode_steps", "disable_env_checker", "vectorization_mode"})
_SEED_MASK = 2**31 - 1
_VERSION = re.compile(r"-v\d+$")
_IMPORTS = re.compile(r"[^A-Za-z0-9_./-]")


def make(environment: str, options: dict[str, Any], render: str) -> Any:  # noqa: ANN401 - Gymnasium is an extra
    """Return the environment, without a cap of its own and with the render mode that suits.

    Args: render: "text" or "picture". Raises: GymError, one line with the mend.
    """
    if _IMPORTS.search(environment):
        raise GymError(f"environment {environment!r}: name a registered one, such as FrozenLake-v1")
    if refused := sorted(RESERVED & set(options)):
        raise GymError(f"option {refused[0]} of {environment} is not yours to set: leave it out")
    try:
        import gymnasium  # noqa: PLC0415 - an extra, and slow to import
    except ImportError:
        raise GymError("Gymnasium is not installed: install sfid[gym]") from None
    from services.gym.registration import register_installed  # noqa: PLC0415 - as above

    with faults(environment), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        register_installed()
        creator = _creator(_registered(environment))
        mode = _render_mode(creator, render)
        _check_known(creator, options)
        with _naming(options):
            return gymnasium.make(
                environment, max_episode_steps=-1, disable_env_checker=True, render_mode=mode, **options
            )


def _registered(environment: str) -> Any:  # noqa: ANN401 - Gymnasium is an extra
    """Return what is registered under a name. Raises: GymError that tells names like it."""
    from gymnasium import error, registry, spec  # noqa: PLC0415 - as above

    try:
        return spec(environment)
    except error.DeprecatedEnv:  # says which one is to be taken
        raise
    except error.Error:
        near = " or ".join(near_names(environment, registry.values()))
        mend = f"did you mean {near}?" if near else "install the package it comes with, or mend its name"
        raise GymError(f"no environment has this name: {mend}") from None


def near_names(name: str, specs: Iterable[Any]) -> list[str]:
    """Return up to three registered names like this one, the nearest first, each in its newest version."""
    newest: dict[tuple[str, str], Any] = {}
    for one in specs:
        key = one.namespace or "", one.name
        if key not in newest or (one.version or 0) > (newest[key].version or 0):
            newest[key] = one
    # By name alone: that two end in -v1 makes nothing alike.
    by_name = {one.name.lower(): one.id for one in newest.values()}
    bare = _VERSION.sub("", name.rpartition("/")[2]).lower()
    return [by_name[near] for near in get_close_matches(bare, by_name)]


@contextmanager
def _naming(options: dict[str, Any]) -> Iterator[None]:
    """Say with which options an environment cannot be made: alone, what a KeyError names is a riddle."""
    try:
        yield
    except (KeyError, ValueError) as error:
        if not options or isinstance(error, GymError):
            raise
        given = ", ".join(f"{name}={value}" for name, value in sorted(options.items()))
        what = f"{type(error).__name__} {error}"
        raise GymError(
            f"it cannot be made with {given} ({what}): give what it knows, or leave it out"
        ) from None


@contextmanager
def faults(environment: str) -> Iterator[None]:
    """Turn whatever other people's code raises into one line."""
    try:
        yield
    except Exception as error:  # noqa: BLE001 - an environment may fail in any way
        raise GymError(f"environment {environment}: {_one_line(error)}") from None


def _creator(spec: Any) -> Any:  # noqa: ANN401 - Gymnasium is an extra
    """Return what makes the environments of a name."""
    from gymnasium.envs.registration import load_env_creator  # noqa: PLC0415 - as above

    point = spec.entry_point
    return point if callable(point) else load_env_creator(point)


def _check_known(creator: Any, options: dict[str, Any]) -> None:  # noqa: ANN401 - as above
    """Refuse options that there are not. Raises: GymError that tells what there is."""
    try:
        parameters = signature(creator).parameters
    except (TypeError, ValueError):  # made by something that is not Python's
        return
    if any(each.kind is Parameter.VAR_KEYWORD for each in parameters.values()):
        return
    unknown = sorted(set(options) - set(parameters))
    if unknown:
        known = ", ".join(sorted(set(parameters) - RESERVED)) or "none"
        raise GymError(f"there is no option {unknown[0]}: choose of {known}")


def _render_mode(creator: Any, render: str) -> str | None:  # noqa: ANN401 - Gymnasium is an extra
    """Return what an environment is drawn with, before it is made: its class says what it can."""
    modes = getattr(creator, "metadata", {}).get("render_modes", ())
    for mode in ("ansi",) if render == "text" else ("rgb_array",):
        if mode in modes:
            return mode
    if render == "picture":
        raise GymError("cannot be drawn as a picture: render it as text")
    return None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__


class GymGround:
    """One environment under one configuration: makes courses, and knows what is best in it if that is known.

    Raises: GymError when it cannot be made, has no finite actions, or is not what the session was told.
    """

    def __init__(self, world: GymWorld, seed: int) -> None:
        self.world, self.seed = world, seed
        self._idle: list[Any] = []
        self._shared: Any = None
        first = self._make()
        if len(world.actions) != action_count(first):
            raise GymError(
                f"environment {world.environment} has {action_count(first)} actions, "
                f"the session names {len(world.actions)}: its version or its options differ"
            )
        self._idle.append(first)
        self.table: Transitions | None = table_of(first)

    @cached_property
    def optimal(self) -> dict[bytes, tuple[int, ...]]:
        """Indexes of the best actions by state key; empty for an environment without a transition table."""
        if self.table is None:
            return {}
        return {state_key(state): row for state, row in enumerate(optimal_actions(self.table.solve()))}

    @cached_property
    def distances(self) -> dict[bytes, int]:
        """Fewest steps to the best ending by state key; empty where chance has a part or nobody knows."""
        if self.table is None or not self.table.is_certain:
            return {}
        return {state_key(s): int(n) for s, n in enumerate(self.table.fewest_steps()) if n >= 0}

    def outcome(self, reward: float, *, ended: bool, cut: bool) -> Outcome:
        """Return how a step leaves its episode.

        Ended well is SOLVED: with the best reward that any ending brings, above 0 where nobody knows them.
        Any other end is FAILED: nothing follows. An environment that cuts itself off is at its CAP.
        """
        if ended:
            well = reward > 0 if self.table is None else reward >= self.table.best_ending
            return Outcome.SOLVED if well else Outcome.FAILED
        return Outcome.CAP if cut else Outcome.RUNNING

    def begin(self, episode: int) -> "GymCourse":
        """Return the episode of that number at its start.

        Where N episodes begin alike, each still has chances of its own on its way.
        """
        starts = self.world.starts
        number = episode if starts == "all" else episode % int(starts)
        seeds = stream(self.seed, "gym-start", number) & _SEED_MASK, stream(self.seed, "gym-chance", episode)
        return GymCourse(self, self._idle.pop() if self._idle else self._make(), seeds)

    def faults(self) -> AbstractContextManager[None]:
        """Turn what the environment raises into one line."""
        return faults(self.world.environment)

    def give_back(self, environment: Any) -> None:  # noqa: ANN401 - any environment
        """Take an environment that nobody plays any longer."""
        self._idle.append(environment)

    def _make(self) -> Any:  # noqa: ANN401 - any environment
        world = self.world
        made = make(world.environment, dict(world.options), world.render)
        table = _table(made)
        if self._shared is None:
            self._shared = table
        else:
            _refuse_another(table, self._shared, world.environment)
            made.unwrapped.P = self._shared  # thousands of sessions need one table
        return made


class GymCourse:
    """One episode of an environment; see `services.environment.Course`."""

    def __init__(self, ground: GymGround, environment: Any, seeds: tuple[int, int]) -> None:  # noqa: ANN401
        self._ground, self._environment, self._seeds = ground, environment, seeds
        self._numbers = {name: index for index, name in enumerate(ground.world.actions)}
        self._taken: tuple[str, ...] = ()
        self._before: tuple[str, ...] = ()
        self.state = b""
        self.view = ""
        self._stand_at(())
        self.start_steps = self.optimal_steps

    @property
    def optimal_steps(self) -> int | None:
        """Fewest steps to the best ending, None where there is no way or nobody knows."""
        return self._ground.distances.get(self.state)

    def act(self, name: str, steps_done: int) -> tuple[float, Outcome]:
        """Take an action, or UNDO, which goes back to where the action before it was taken.

        Returns (reward, outcome). Raises: GymError for an action that the environment does not have.
        """
        capped = steps_done + 1 >= self._ground.world.steps_max
        if name == UNDO:
            taken, self._before = self._before, self._taken
            self._stand_at(taken)
            return 0.0, Outcome.CAP if capped else Outcome.RUNNING
        reward, outcome = self._step(name)
        self._taken, self._before = (*self._taken, name), self._taken
        if outcome is Outcome.RUNNING and capped:
            outcome = Outcome.CAP
        return reward * self._ground.world.reward_scale, outcome

    def close(self) -> None:
        """Give the environment back; the course is over."""
        if self._environment is not None:
            self._ground.give_back(self._environment)
            self._environment = None

    def _stand_at(self, taken: tuple[str, ...]) -> None:
        start, chance = self._seeds
        with self._ground.faults():
            observation, _ = self._environment.reset(seed=start)
            self._environment.unwrapped.np_random = np.random.default_rng(chance)
            self._see(observation)
        for name in taken:
            self._step(name)
        self._taken = taken

    def _step(self, name: str) -> tuple[float, Outcome]:
        if name not in self._numbers:
            raise GymError(f"no action {name}: use one of {', '.join(self._numbers)}")
        first = int(getattr(self._environment.action_space, "start", 0))
        with self._ground.faults():
            observation, reward, ended, cut, _ = self._environment.step(first + self._numbers[name])
            self._see(observation)
        return float(reward), self._ground.outcome(float(reward), ended=bool(ended), cut=bool(cut))

    def _see(self, observation: Any) -> None:  # noqa: ANN401 - environments observe what they like
        self.state = state_key(observation)
        self.view = view_of(self._environment, observation)


def view_of(environment: Any, observation: Any) -> str:  # noqa: ANN401 - any environment
    """Return what teachers see of an environment that was reset. Raises: GymError when it does not fit."""
    mode = environment.render_mode
    if mode:
        drawn = _rendered(environment, mode)
        view = as_text(drawn) if mode == "ansi" else as_picture(drawn)
    else:
        grid = getattr(environment.unwrapped, "pprint_grid", None)  # MiniGrid's map
        view = as_observed(observation if grid is None else grid())
    if len(view) > VIEW_MAX:
        raise GymError(f"a view takes {len(view)} characters, {VIEW_MAX} fit: render it another way")
    return view


def _rendered(environment: Any, mode: str) -> Any:  # noqa: ANN401 - any environment
    from gymnasium.error import DependencyNotInstalled  # noqa: PLC0415 - an extra, and slow to import

    try:
        return environment.render()
    except DependencyNotInstalled as error:
        mend = "" if mode == "ansi" else ", or leave --gym-render picture out"
        raise GymError(f"it cannot be drawn: {str(error).replace(chr(34), chr(39))}{mend}") from None


def _table(environment: Any) -> Any:  # noqa: ANN401 - any environment
    return getattr(environment.unwrapped, "P", None)


def _refuse_another(table: Any, first: Any, environment: str) -> None:  # noqa: ANN401 - any environment
    """Refuse an environment that is drawn anew each time it is made: it could not be restored."""
    if table != first:
        raise GymError(
            f"environment {environment} is another one each time it is made: "
            "give the options that fix it (a map, a size)"
        )


def action_count(environment: Any) -> int:  # noqa: ANN401 - any environment
    """Return how many actions it has. Raises: GymError when they are not 1 to 64 numbers."""
    count = getattr(environment.action_space, "n", None)
    if count is None or getattr(environment.action_space, "shape", ()) != ():
        raise GymError("its actions are no finite list: take an environment with discrete actions")
    if not 1 <= int(count) <= 64:
        raise GymError(f"it has {count} actions, 1 to 64 can be taught: take another environment")
    return int(count)


def described(
    environment: str,
    options: dict[str, Any],
    *,
    starts: str = "4",
    render: str = "text",
    actions: tuple[str, ...] = (),
    reward_scale: float = 1.0,
    steps_max: int | None = None,
) -> GymWorld:
    """Return the world of an environment, completed by what it says of itself.

    Args: actions: names by index, known or made up when empty; steps_max: the environment's own when None.
    Raises: GymError, one line with the mend.
    """
    if not (starts == "all" or re.fullmatch(r"[1-9][0-9]{0,6}", starts)):
        raise GymError(f"starts {starts!r}: an environment has a number of starts, or all")
    made = make(environment, options, render)
    try:
        with faults(environment):
            count, table = action_count(made), table_of(made)
            observation, _ = made.reset(seed=0)
            state_key(observation)
            view_of(made, observation)
        again = make(environment, options, render)
        again.close()
        _refuse_another(_table(again), _table(made), environment)
        if actions and len(actions) != count:
            raise GymError(f"{len(actions)} names for the {count} actions of {environment}: name each")
        cap = steps_max or getattr(made.spec, "max_episode_steps", None) or _own_cap(environment)
        own = made.spec.id
    finally:
        made.close()
    set_options = ", ".join(f"{name}={value}" for name, value in sorted(options.items()))
    return GymWorld(
        environment=own,
        options=options,
        actions=actions or action_names(own, count),
        starts=starts,
        level_name=f"{own} ({set_options})" if set_options else own,
        render="picture" if render == "picture" else "text",
        reward_scale=reward_scale,
        goal_reward=None if table is None else table.best_ending * reward_scale,
        step_reward=0.0 if table is None else table.step_reward * reward_scale,
        steps_max=cap,
    )


def _own_cap(environment: str) -> int:
    import gymnasium  # noqa: PLC0415 - an extra, and slow to import

    return gymnasium.spec(environment).max_episode_steps or STEPS_MAX
