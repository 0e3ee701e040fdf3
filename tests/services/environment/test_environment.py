"""The environment: exactly once by decision, bound to an epoch, and rebuilt from what was done."""

import queue
import threading

import msgspec
import pytest

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Refusal, Wire, World
from protocol.status_message import ServiceStatus
from protocol.world_messages import Begin, Begun, ExecuteAction, Executed
from services.environment import EPISODES_MAX, WORLDS_MAX, Environment, EnvironmentConfig, run
from services.runtime.bus import Presence, Reply
from services.runtime.memory_bus import MemoryBus, MemoryHub
from sfid_core.sokoban.levels import packaged

ROOM = World(level=packaged("room")[0].to_xsb(), level_name="room", starts="4")
ONE_PUSH = World(level="#####\n#@$.#\n#####", level_name="push", starts="1")
WALK = ("RIGHT", "UP", "UP", "UP", "LEFT")


def begin(environment: Environment, **changes: object) -> Begun:
    reply = environment.handle("begin", encode(asked_to_begin(**changes)))
    assert isinstance(reply, Begun), reply
    return reply


def asked_to_begin(**changes: object) -> Begin:
    asked = Begin(session="s1", epoch=1, episode=0, seed=7, world=ROOM)
    return msgspec.structs.replace(asked, **changes)


def step(begun: Begun, action: str, decision: int = 0, **changes: object) -> ExecuteAction:
    asked = ExecuteAction(
        session="s1", epoch=1, decision=decision, episode=begun.episode, step=begun.step, state=begun.state,
        action=action,
    )  # fmt: skip
    return msgspec.structs.replace(asked, **changes)


def execute(environment: Environment, asked: ExecuteAction) -> Wire:
    return environment.handle("execute", encode(asked))


def walked(environment: Environment, begun: Begun, actions: tuple[str, ...]) -> Executed:
    """Execute the actions one after the other and return the last reply."""
    replies: list[Executed] = []
    for number, action in enumerate(actions):
        state = replies[-1].state if replies else begun.state
        reply = execute(environment, step(begun, action, number, step=number, state=state))
        assert isinstance(reply, Executed), reply
        replies.append(reply)
    return replies[-1]


def test_a_repeated_decision_is_answered_with_the_same_result_and_not_executed_again() -> None:
    environment = Environment()
    begun = begin(environment)
    asked = step(begun, "UP")
    first = execute(environment, asked)
    assert isinstance(first, Executed)
    assert [execute(environment, asked) for _ in range(3)] == [first] * 3
    onward = execute(environment, step(begun, "DOWN", 1, step=1, state=first.state))
    assert isinstance(onward, Executed)


def test_another_action_for_an_executed_decision_is_refused() -> None:
    environment = Environment()
    begun = begin(environment)
    execute(environment, step(begun, "UP"))
    reply = execute(environment, step(begun, "LEFT"))
    assert reply == Refusal(
        code="unknown-session", reason="the episode stands elsewhere: begin it with the actions taken"
    )


def test_an_older_epoch_is_denied_from_the_first_word_of_a_newer_one_on() -> None:
    environment = Environment()
    begun = begin(environment, epoch=3)
    assert isinstance(execute(environment, step(begun, "UP", epoch=4)), Executed)
    for epoch in (1, 2, 3):
        for reply in (
            execute(environment, step(begun, "UP", epoch=epoch)),
            environment.handle("begin", encode(asked_to_begin(epoch=epoch))),
        ):
            assert reply == Refusal(
                code="denied", reason=f"epoch {epoch} is over: a learner of epoch 4 owns the session"
            )


def test_an_episode_restored_from_its_actions_stands_where_the_first_one_stood() -> None:
    first, second = Environment(), Environment()
    begun = begin(first, episode=2)
    there = walked(first, begun, WALK)
    restored = begin(second, episode=2, epoch=5, actions=WALK)
    assert restored == Begun(
        episode=2,
        step=len(WALK),
        state=there.state,
        view=there.view,
        optimal_steps=begun.optimal_steps,
        actions=("LEFT", "RIGHT", "UP", "DOWN"),
    )
    goes_on = [execute(environment, step(restored, "UP", 5, epoch=9)) for environment in (first, second)]
    assert goes_on[0] == goes_on[1]


def test_what_was_never_begun_is_unknown() -> None:
    begun = begin(Environment())
    reply = execute(Environment(), step(begun, "UP"))
    assert reply == Refusal(code="unknown-session", reason="no episode of session s1 runs here: begin it")


def test_a_finished_episode_repeats_its_last_reply_and_executes_no_more() -> None:
    environment = Environment()
    begun = begin(environment, world=ONE_PUSH)
    solved = execute(environment, step(begun, "RIGHT"))
    assert isinstance(solved, Executed)
    assert (solved.outcome, solved.reward) == ("solved", 10.0)
    assert execute(environment, step(begun, "RIGHT")) == solved
    more = execute(environment, step(begun, "LEFT", 1, step=1, state=solved.state))
    assert isinstance(more, Refusal)
    assert more.code == "unknown-session"


@pytest.mark.parametrize("verb", ["begin", "execute"])
@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x80", b"x" * 70_000, encode(ExecuteAction(
    session="s1", epoch=0, decision=0, episode=0, step=0, state=b"", action="UP"))[:-1]])  # fmt: skip
def test_what_cannot_be_read_is_malformed(verb: str, payload: bytes) -> None:
    reply = Environment().handle(verb, payload)
    assert isinstance(reply, Refusal)
    assert reply.code == "malformed"


def test_a_world_or_an_action_that_cannot_be_is_invalid_with_its_fault() -> None:
    environment = Environment()
    begun = begin(environment)
    replies = [
        environment.handle("begin", encode(asked_to_begin(world=World(level="####\n#@ #\n####")))),
        environment.handle(
            "begin", encode(asked_to_begin(world=msgspec.structs.replace(ROOM, starts="9999999")))
        ),
        environment.handle("begin", encode(asked_to_begin(actions=("JUMP",)))),
        execute(environment, step(begun, "JUMP")),
    ]
    reasons = [reply.reason for reply in replies if isinstance(reply, Refusal) and reply.code == "invalid"]
    assert [reason.split(":")[0] for reason in reasons] == [
        "level 0, lines 1-3", "starts", "no action JUMP", "no action JUMP",
    ]  # fmt: skip
    assert environment.refused == {"invalid": 4}
    assert isinstance(execute(environment, step(begun, "UP")), Executed)


def test_worlds_and_episodes_are_bounded_and_the_oldest_comes_back_by_itself() -> None:
    environment = Environment()
    for seed in range(WORLDS_MAX + 5):
        begin(environment, seed=seed, world=ONE_PUSH)
    assert len(environment._worlds) == WORLDS_MAX  # noqa: SLF001 - memory has no other witness
    for number in range(EPISODES_MAX + 5):
        begin(environment, session=f"t{number}", world=ONE_PUSH)
    assert len(environment._episodes) == EPISODES_MAX  # noqa: SLF001 - as above
    begun = begin(environment, session="t0", world=ONE_PUSH)
    assert isinstance(execute(environment, step(begun, "RIGHT", session="t0")), Executed)


def test_the_service_answers_on_the_bus_announces_itself_and_ends_when_told() -> None:
    hub, keys, stop, ready = MemoryHub(inline=True), Keys("lab"), threading.Event(), threading.Event()
    bus, other = MemoryBus(hub), MemoryBus(hub)
    seen: list[Presence] = []
    other.watch(keys.service(), seen.append)
    arguments = (EnvironmentConfig("lab"), bus, ready.set, stop)
    service = threading.Thread(target=run, args=arguments)
    service.start()
    assert ready.wait(10)
    replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    other.ask(keys.environment("begin"), encode(asked_to_begin()), replies.put, 10_000)
    good = replies.get(timeout=10)
    other.ask(keys.environment("execute"), b"nonsense", replies.put, 10_000)
    bad = replies.get(timeout=10)
    other.ask(keys.status("environment", "environment"), b"", replies.put, 10_000)
    told = replies.get(timeout=10)
    stop.set()
    service.join(10)
    assert not service.is_alive()
    assert good is not None
    assert bad is not None
    assert (decode(good.payload, Begun), good.ok) == (begin(Environment()), True)
    assert (decode(bad.payload, Refusal).code, bad.ok) == ("malformed", False)
    assert told is not None
    status = decode(told.payload, ServiceStatus)
    assert (status.sessions, status.running, status.refused) == (1, 1, {"malformed": 1})
    assert seen == [Presence(keys.service("environment", "environment"), present=True)]
