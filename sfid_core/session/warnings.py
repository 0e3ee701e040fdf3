"""What is allowed in a session's configuration and seldom meant: rewards under which not finishing pays."""

from collections.abc import Iterator, Mapping
from math import ceil

from sfid_core.learning.parameters import Value, as_written
from sfid_core.session.config import SessionConfig

_CURES = {
    "sfid": "-p omega=penalty",
    "sfid-memory": "-p policy=model",
    "tamer-rl": "-p technique=action-biasing",
}
"""How a method itself keeps praise from adding up."""


def circuit_warnings(
    config: SessionConfig, *, scale: float | None = None, sets_parameters: bool = True
) -> tuple[str, ...]:
    """Return what to mind about a session, one line each, with the cure; none where all is well.

    Positive circuits: praise of up to h a step adds up to more than the goal where
    R_goal < (h + c) gamma / (1 - gamma), with c the step's reward (see `experiments.circuits.bound`). The
    opposite trap: where steps cost and a deadlock costs less than walking on for ever, dying pays.

    Args: scale: what the rewards of an environment are multiplied by already, whose only cure is to multiply
    them by more; None: they are set one by one.  sets_parameters: whether the method's can be set.
    """
    return (*_circuits(config, scale, sets_parameters=sets_parameters), *_dying(config))


def praise_max(config: SessionConfig) -> float:
    """Return the most that a teacher's answer adds to the value that a method bootstraps; 0: none ever does.

    TAMER, cloning, Advise and their like keep the teacher's part out of the values, so it cannot add up.
    """
    written = as_written(config.method_parameters)
    if config.method in {"reward", "guidance"}:
        return 1.0
    if config.method == "sfid":
        return 0.0 if written["omega"] == "penalty" else 1.0
    if config.method == "sfid-memory":
        return 1.0 if written["policy"] == "shaped" and written["omega"] != "penalty" else 0.0
    if config.method == "tamer-rl" and written["technique"] in {"reward-shaping", "q-augmentation"}:
        return _number(written, "weight")
    return 0.0


def _circuits(config: SessionConfig, scale: float | None, *, sets_parameters: bool) -> tuple[str, ...]:
    world, gamma = config.world, _number(as_written(config.method_parameters), "gamma")
    praise = praise_max(config)
    needed = (praise + world.step_reward) * gamma / (1.0 - gamma)
    # A hair less is enough: 0.9 / (1 - 0.9) is above 9, and what is advised here must do.
    if praise == 0.0 or world.goal_reward >= needed * (1 - 1e-9):
        return ()
    cures = _cures(config, praise, needed, scale, sets_parameters=sets_parameters)
    line = (
        f"method {config.method} with goal reward {world.goal_reward:g} and gamma {gamma:g}: praise for "
        f"walking round can be worth more than finishing, which needs {needed:.3g}; "
        f"use {_one_of(list(cures))}"
    )
    return (line,)


def _cures(
    config: SessionConfig, praise: float, needed: float, scale: float | None, *, sets_parameters: bool
) -> Iterator[str]:
    world, gamma = config.world, _number(as_written(config.method_parameters), "gamma")
    if scale is None:
        yield f"a goal reward of {needed:.3g} or more"
    else:
        # Goal and step alike are multiplied: k (goal - step g) >= praise g, with g = gamma / (1 - gamma).
        steps = gamma / (1.0 - gamma)
        worth = world.goal_reward - world.step_reward * steps
        if worth > 0.0:
            yield f"`--reward-scale {ceil(scale * praise * steps / worth * 100 - 1e-6) / 100:g}` or more"
    if sets_parameters:
        lower = praise + world.step_reward
        below = max(0.0, world.goal_reward / (world.goal_reward + lower)) if world.goal_reward > 0 else 0.0
        yield f"gamma up to {_floor(below)}"
    if scale is None:
        yield f"a step reward of {-praise:g}"
    if not sets_parameters:
        yield "a method that keeps praise out of its values (`--method tamer`)"
    elif config.method in _CURES:
        yield _CURES[config.method]
    else:
        yield "a method that keeps praise out of its values (tamer, sfid -p omega=penalty)"


def _one_of(choices: list[str]) -> str:
    """Return a list in words, its last part after `or`."""
    *first, last = choices
    comma = "," if len(first) > 1 else ""
    return f"{', '.join(first)}{comma} or {last}" if first else last


def _dying(config: SessionConfig) -> tuple[str, ...]:
    world, gamma = config.world, _number(as_written(config.method_parameters), "gamma")
    walking = world.step_reward / (1.0 - gamma)
    if world.step_reward >= 0.0 or world.deadlock_reward <= walking:
        return ()
    line = (
        f"step reward {world.step_reward:g} and deadlock reward {world.deadlock_reward:g}: dying costs less "
        f"than walking on ({walking:.3g} at gamma {gamma:g}), so without a teacher it pays; "
        f"use a deadlock reward of {walking:.3g} or less"
    )
    return (line,)


def _floor(gamma: float) -> str:
    """Return two digits that are not above the number."""
    return f"{int(gamma * 100) / 100:g}"


def _number(written: Mapping[str, Value], name: str) -> float:
    """Return a parameter that is a number in every method that has it."""
    return float(written[name])
