"""Worlds and a driver for the tests of Gymnasium environments."""

from typing import Any

import msgspec

from protocol.codec import encode
from protocol.messages import GymWorld, Refusal
from protocol.world_messages import Begin, Begun, ExecuteAction, Executed
from services.environment import Environment
from services.gym.world import described

DRY_LAKE = described("FrozenLake-v1", {"is_slippery": False})
ICE = described("FrozenLake-v1", {"is_slippery": True})
TAXI = described("Taxi-v4", {})
CLIFF = described("CliffWalking-v1", {})


def begun(
    environment: Environment, world: GymWorld, *, episode: int = 0, actions: tuple[str, ...] = ()
) -> Begun:
    """Begin an episode, with actions already taken."""
    asked = Begin(session="s1", epoch=1, episode=episode, seed=7, world=world, actions=actions)
    reply = environment.handle("begin", encode(asked))
    assert isinstance(reply, Begun), reply
    return reply


def refused(world: GymWorld, changes: dict[str, Any]) -> Refusal:
    """Begin an episode of a world that cannot be one."""
    wrong = msgspec.structs.replace(world, **changes)
    asked = Begin(session="s1", epoch=1, episode=0, seed=7, world=wrong)
    reply = Environment().handle("begin", encode(asked))
    assert isinstance(reply, Refusal), reply
    return reply


def executed(
    environment: Environment, at: Begun | Executed, decision: int, action: str, *, episode: int = 0
) -> Executed:
    """Take an action; decisions and steps run alike."""
    asked = ExecuteAction(
        session="s1",
        epoch=1,
        decision=decision,
        episode=episode,
        step=decision,
        state=at.state,
        action=action,
    )
    reply = environment.handle("execute", encode(asked))
    assert isinstance(reply, Executed), reply
    return reply


def walked(environment: Environment, world: GymWorld, actions: tuple[str, ...]) -> list[Executed]:
    """Begin and take the actions one after another."""
    at: Begun | Executed = begun(environment, world)
    replies = []
    for decision, action in enumerate(actions):
        at = executed(environment, at, decision, action)
        replies.append(at)
    return replies
