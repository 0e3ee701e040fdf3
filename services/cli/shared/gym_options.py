"""The options that name a Gymnasium environment in place of a level."""

from collections.abc import Mapping
from typing import Annotated, Any

import typer

from protocol.messages import GymWorld
from services.cli.shared.failure import CommandError

Gym = Annotated[
    str | None,
    typer.Option(help="A discrete Gymnasium environment in place of a level, such as FrozenLake-v1."),
]
GymOption = Annotated[
    list[str] | None,
    typer.Option(help="What the environment is made with, NAME=VALUE (is_slippery=false); may be repeated."),
]
GymActions = Annotated[
    str | None, typer.Option(help="Names of its actions by index, parted by commas, where they have none.")
]
GymRender = Annotated[str, typer.Option(help="What teachers see of it: text or picture.")]
RewardScale = Annotated[float, typer.Option(help="What the environment's rewards are multiplied by.")]
_WORDS: dict[str, Any] = {"true": True, "false": False, "none": None}


def gym_world(
    gym: str | None,
    options: list[str] | None,
    actions: str | None,
    render: str = "text",
    reward_scale: float = 1.0,
    starts: str = "4",
) -> GymWorld | None:
    """Return the world that the options name, None without `--gym`.

    Raises: CommandError, one line with the mend.
    """
    if gym is None:
        if options or actions is not None:
            raise CommandError("--gym-option and --gym-actions speak of an environment: name it with --gym")
        return None
    if not gym.strip():
        raise CommandError("--gym names no environment: give a registered one, such as FrozenLake-v1")
    named = () if actions is None else tuple(name.strip().upper() for name in actions.split(","))
    if not all(named):
        raise CommandError(
            f"--gym-actions {actions!r} leaves a name empty: name each, such as LEFT,DOWN,RIGHT,UP"
        )
    if render not in {"text", "picture"}:
        raise CommandError(f"--gym-render {render!r}: choose text or picture")
    from services.gym.errors import GymError
    from services.gym.world import described

    try:
        return described(
            gym,
            gym_options(options),
            starts=starts,
            render=render,
            actions=named,
            reward_scale=reward_scale,
        )
    except GymError as error:
        raise CommandError(str(error)) from None


def gym_options(written: list[str] | None) -> dict[str, bool | int | float | str | None]:
    """Return what an environment is made with, from NAME=VALUE texts: true, false, none, numbers or words."""
    given: dict[str, bool | int | float | str | None] = {}
    for text in written or ():
        name, equals, value = text.partition("=")
        if not equals:
            raise CommandError(f"option {text!r} has no value: write NAME=VALUE, such as is_slippery=false")
        if not name.strip():
            raise CommandError(f"option {text!r} has no name: write NAME=VALUE, such as is_slippery=false")
        given[name.strip()] = _value(value.strip())
    return given


def _value(text: str) -> bool | float | str | None:
    if text.lower() in _WORDS:
        word: bool | None = _WORDS[text.lower()]
        return word
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def gym_flags(world: GymWorld) -> tuple[str, ...]:
    """Return the flags that name the same world to another process."""
    options = (flag for name, value in world.options.items() for flag in ("--gym-option", f"{name}={value}"))
    return ("--gym", world.environment, *options, "--gym-actions", ",".join(world.actions))


def best_of(
    gym: str | None, options: list[str] | None, actions: str | None
) -> Mapping[bytes, tuple[int, ...]] | None:
    """Return what is best in each state of the environment that the options name, None without `--gym`.

    Raises: CommandError where there is none, or nobody can know it.
    """
    world = gym_world(gym, options, actions)
    return None if world is None else best_actions(world)


def best_actions(world: GymWorld) -> Mapping[bytes, tuple[int, ...]]:
    """Return what is best in each state of an environment. Raises: CommandError where nobody can know it."""
    from services.gym.errors import GymError
    from services.gym.world import GymGround

    try:
        best = GymGround(world, 0).optimal
    except GymError as error:
        raise CommandError(str(error)) from None
    if not best:
        raise CommandError(
            f"environment {world.environment} does not tell its transitions (env.unwrapped.P), "
            "so no script can solve it: let people teach it"
        )
    return best
