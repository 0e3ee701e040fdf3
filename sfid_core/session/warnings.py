"""What is allowed in a session's configuration and seldom meant: rewards under which not finishing pays."""

from collections.abc import Mapping

from sfid_core.learning.parameters import Value, as_written
from sfid_core.session.config import SessionConfig

_CURES = {
    "sfid": "-p omega=penalty",
    "sfid-memory": "-p policy=model",
    "tamer-rl": "-p technique=action-biasing",
}
"""How a method itself keeps praise from adding up."""


def circuit_warnings(config: SessionConfig) -> tuple[str, ...]:
    """Return what to mind about a session, one line each, with the cure; none where all is well.

    Positive circuits: praise of up to h a step adds up to more than the goal where
    R_goal < (h + c) gamma / (1 - gamma), with c the step's reward (see `experiments.circuits.bound`). The
    opposite trap: where steps cost and a deadlock costs less than walking on for ever, dying pays.
    """
    return (*_circuits(config), *_dying(config))


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


def _circuits(config: SessionConfig) -> tuple[str, ...]:
    world, gamma = config.world, _number(as_written(config.method_parameters), "gamma")
    praise = praise_max(config)
    needed = (praise + world.step_reward) * gamma / (1.0 - gamma)
    if praise == 0.0 or world.goal_reward >= needed:
        return ()
    lower = praise + world.step_reward
    below = max(0.0, world.goal_reward / (world.goal_reward + lower)) if world.goal_reward > 0 else 0.0
    cures = [f"a goal reward of {needed:.3g} or more", f"gamma up to {_floor(below)}"]
    cures += [f"a step reward of {-praise:g}"]
    if config.method in _CURES:
        cures.append(_CURES[config.method])
    else:
        cures.append("a method that keeps praise out of its values (tamer, sfid -p omega=penalty)")
    line = (
        f"method {config.method} with goal reward {world.goal_reward:g} and gamma {gamma:g}: praise for "
        f"walking round can be worth more than finishing, which needs {needed:.3g}; "
        f"use {', '.join(cures[:-1])}, or {cures[-1]}"
    )
    return (line,)


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
