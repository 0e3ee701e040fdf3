"""What a crowd asks about sessions is answered by the learners, one or several."""

import pytest

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Refusal, SessionList, SessionQuery, SessionSummary
from services.aggregator.relay import Relay
from services.runtime.bus import Reply
from services.runtime.memory_bus import MemoryBus, MemoryHub

LEARNERS, CROWD = Keys("local"), Keys("local-crowd")


def summary(name: str) -> SessionSummary:
    return SessionSummary(
        session=name, method="sfid", level_name="room", phase="asking", paused=False, episode=0, episodes=1,
        decision=0, teachers=(),
    )  # fmt: skip


@pytest.fixture
def hub() -> MemoryHub:
    hub = MemoryHub()
    Relay(MemoryBus(hub), LEARNERS).open(CROWD)
    return hub


def learner(hub: MemoryHub, reply: Reply | None, verb: str = "list") -> None:
    """Start a learner that shares the key and replies so, or drops the request."""
    MemoryBus(hub).serve(
        LEARNERS.learner(verb),
        lambda request: (
            None if reply is None else (request.reply if reply.ok else request.reply_error)(reply.payload)
        ),
        shared=True,
    )


def asked(hub: MemoryHub, verb: str = "list") -> Reply | None:
    heard: list[Reply | None] = []
    MemoryBus(hub).ask(CROWD.learner(verb), encode(SessionQuery()), heard.append, 1_000)
    while hub.deliver_all():
        pass
    assert len(heard) == 1
    return heard[0]


def listing(*names: str) -> Reply:
    return Reply(encode(SessionList(sessions=tuple(summary(name) for name in names))))


def test_the_lists_of_several_learners_become_one_with_the_latest_of_each_last(hub: MemoryHub) -> None:
    for reply in (listing("a1", "a2"), listing("b1"), None, listing()):
        learner(hub, reply)
    told = asked(hub)
    assert told is not None
    names = [one.session for one in decode(told.payload, SessionList).sessions]
    assert (names[0], sorted(names[1:])) == ("a1", ["a2", "b1"])


def test_the_list_of_one_learner_is_handed_on_as_it_is(hub: MemoryHub) -> None:
    learner(hub, listing("a1"))
    learner(hub, None)
    assert asked(hub) == listing("a1")


def test_a_refusal_is_handed_on_where_there_is_no_list_and_nothing_where_nobody_replies(
    hub: MemoryHub,
) -> None:
    learner(hub, None)
    assert asked(hub) is None
    refusal = Reply(encode(Refusal(code="busy", reason="later")), ok=False)
    learner(hub, refusal)
    assert asked(hub) == refusal
    learner(hub, listing("a1"))
    assert asked(hub) == listing("a1")


def test_lists_that_cannot_be_read_are_no_answer(hub: MemoryHub) -> None:
    learner(hub, Reply(b"nonsense"))
    learner(hub, listing("a1"))
    assert asked(hub) is None


def test_a_question_about_a_session_gets_the_reply_of_whoever_has_it(hub: MemoryHub) -> None:
    learner(hub, None, "show")
    learner(hub, Reply(b"the report"), "show")
    assert asked(hub, "show") == Reply(b"the report")
