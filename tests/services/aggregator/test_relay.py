"""What a crowd asks about sessions is answered by the learners, one or several."""

import pytest

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Refusal, SessionList, SessionQuery, SessionSummary
from protocol.session_union import left_out, list_query, page, untold
from services.aggregator.relay import LIST_TIMEOUT_MS, Relay
from services.operator import TIMEOUT_MS, Operator
from services.runtime.bus import Reply, Request
from services.runtime.memory_bus import MemoryBus, MemoryHub

LEARNERS, CROWD = Keys("local"), Keys("local-crowd")


LONG = "\N{SNOWMAN}" * 512
"""A level's name of 1.5 KB: 37 of these sessions fit in a message."""


def summary(name: str, level_name: str = "room") -> SessionSummary:
    return SessionSummary(
        session=name, method="sfid", level_name=level_name, phase="asking", paused=False, episode=0,
        episodes=1, decision=0, teachers=(),
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


def asked(hub: MemoryHub, verb: str = "list", payload: bytes | None = None) -> Reply | None:
    heard: list[Reply | None] = []
    question = encode(SessionQuery()) if payload is None else payload
    MemoryBus(hub).ask(CROWD.learner(verb), question, heard.append, 1_000)
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


def teach(hub: MemoryHub, shard: int, shards: int, count: int) -> list[str]:
    """Start a learner that has so many sessions, and return their names."""
    held = [f"shard{shard}-{number}" for number in range(count)]

    def serve(request: Request) -> None:
        leave_out = list_query(request.payload).leave_out
        after = held[::-1][left_out(leave_out, shard, shards) :]
        request.reply(encode(page((summary(name, LONG) for name in after), leave_out, shard, shards)))

    MemoryBus(hub).serve(LEARNERS.learner("list"), serve, shared=True)
    return held


@pytest.mark.parametrize("sizes", [(90,), (90, 5, 0), (40, 41, 42)])
def test_a_crowd_reads_all_pages_of_all_learners(sizes: tuple[int, ...]) -> None:
    hub = MemoryHub(inline=True)
    Relay(MemoryBus(hub), LEARNERS).open(CROWD)
    held = [name for shard, size in enumerate(sizes) for name in teach(hub, shard, len(sizes), size)]
    whole = Operator(MemoryBus(hub), CROWD).sessions()
    assert sorted(one.session for one in whole.sessions) == sorted(held)
    assert untold(whole) == ()


def test_a_crowd_is_told_which_shard_has_no_learner() -> None:
    hub = MemoryHub(inline=True)
    Relay(MemoryBus(hub), LEARNERS).open(CROWD)
    held = [*teach(hub, 0, 3, 50), *teach(hub, 2, 3, 2)]
    whole = Operator(MemoryBus(hub), CROWD).sessions()
    assert sorted(one.session for one in whole.sessions) == sorted(held)
    assert untold(whole) == (1,)


def test_a_question_for_the_list_that_cannot_be_read_is_refused_and_an_empty_one_is_not(
    hub: MemoryHub,
) -> None:
    learner(hub, listing("a1"))
    told = asked(hub, payload=b"nonsense")
    assert told is not None
    assert (told.ok, decode(told.payload, Refusal).code) == (False, "malformed")
    assert asked(hub, payload=b"") == listing("a1")


def test_a_list_is_handed_back_while_the_asker_still_waits_though_a_learner_hangs() -> None:
    assert 0 < LIST_TIMEOUT_MS <= TIMEOUT_MS - 250
