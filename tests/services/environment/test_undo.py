"""Taking a step back: the world is put back, exactly once, across a restart, and it counts as a step."""

from protocol.codec import encode
from protocol.messages import World
from protocol.world_messages import UNDO, Begin, Begun, ExecuteAction, Executed
from services.environment import Environment
from sfid_core.sokoban.levels import packaged

ROOM = World(level=packaged("room")[0].to_xsb(), level_name="room", starts="1", steps_max=6)


def began(environment: Environment, actions: tuple[str, ...] = ()) -> Begun:
    asked = Begin(session="s1", epoch=1, episode=0, seed=7, world=ROOM, actions=actions)
    reply = environment.handle("begin", encode(asked))
    assert isinstance(reply, Begun), reply
    return reply


def executed(environment: Environment, decision: int, state: bytes, action: str) -> Executed:
    asked = ExecuteAction(
        session="s1", epoch=1, decision=decision, episode=0, step=decision, state=state, action=action
    )
    reply = environment.handle("execute", encode(asked))
    assert isinstance(reply, Executed), reply
    return reply


def test_undo_puts_the_world_back_and_pays_nothing() -> None:
    environment = Environment()
    start = began(environment)
    moved = executed(environment, 0, start.state, "UP")
    back = executed(environment, 1, moved.state, UNDO)
    assert moved.state != start.state
    assert (back.state, back.view, back.reward, back.outcome) == (start.state, start.view, 0.0, "running")
    assert back.optimal_steps == start.optimal_steps


def test_a_repeated_undo_is_executed_once() -> None:
    environment = Environment()
    start = began(environment)
    first = executed(environment, 0, start.state, "UP")
    second = executed(environment, 1, first.state, "UP")
    assert executed(environment, 2, second.state, UNDO) == executed(environment, 2, second.state, UNDO)
    assert executed(environment, 3, first.state, "UP").state == second.state


def test_an_environment_that_forgot_restores_what_was_taken_back() -> None:
    environment = Environment()
    start = began(environment)
    first = executed(environment, 0, start.state, "UP")
    second = executed(environment, 1, first.state, "LEFT")
    executed(environment, 2, second.state, UNDO)
    again = began(Environment(), ("UP", "LEFT", UNDO))
    assert (again.state, again.step) == (first.state, 3)


def test_an_undo_is_a_step_and_may_be_the_last() -> None:
    environment = Environment()
    state = began(environment).state
    for decision, action in enumerate(("UP", "DOWN", "UP", "DOWN", "UP")):
        state = executed(environment, decision, state, action).state
    assert executed(environment, 5, state, UNDO).outcome == "cap"
