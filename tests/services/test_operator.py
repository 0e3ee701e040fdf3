"""What the command line is told where several learners answer, and some of them cannot just now."""

from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Refusal, SessionList, SessionQuery, SessionSummary
from protocol.session_union import untold
from services.operator import Operator, OperatorError
from services.runtime.bus import Request
from services.runtime.memory_bus import MemoryBus, MemoryHub

KEYS = Keys("local")
BUSY = encode(Refusal(code="busy", reason="the inbox is full: send it again"))


class EnoughError(Exception):
    """The test has seen enough."""


def listed(name: str, **more: Any) -> SessionList:  # noqa: ANN401 - any field
    summary = SessionSummary(
        session=name, method="q-learning", level_name="room", phase="asking", paused=False, episode=0,
        episodes=2, decision=0, teachers=(),
    )  # fmt: skip
    return SessionList(sessions=(summary,), **more)


def answering(answer: SessionList | bytes) -> Callable[[Request], None]:
    def serve(request: Request) -> None:
        if isinstance(answer, bytes):
            request.reply_error(answer)
        else:
            request.reply(encode(answer))

    return serve


def operator(*answers: SessionList | bytes, pauses: int = 0) -> tuple[Operator, list[float]]:
    """Return an operator where each learner always answers the same, and the pauses that it makes."""
    hub = MemoryHub(inline=True)
    for answer in answers:
        MemoryBus(hub).serve(KEYS.learner("list"), answering(answer), shared=True)
    paused: list[float] = []

    def pause(seconds: float) -> None:
        paused.append(seconds)
        if len(paused) > pauses:
            raise EnoughError

    return Operator(MemoryBus(hub), KEYS, pause=pause), paused


def test_the_lists_of_those_who_answer_are_shown_though_one_learner_is_busy() -> None:
    asking, paused = operator(BUSY, listed("s1"), listed("s2"))
    assert sorted(one.session for one in asking.sessions().sessions) == ["s1", "s2"]
    assert paused == []


def test_learners_that_are_all_busy_are_asked_again() -> None:
    asking, paused = operator(BUSY, BUSY, pauses=2)
    with pytest.raises(EnoughError):
        asking.sessions()
    assert len(paused) == 3


def test_a_refusal_for_good_is_told_at_once_in_its_own_words() -> None:
    asking, paused = operator(encode(Refusal(code="denied", reason="not for you: ask for a login")))
    with pytest.raises(OperatorError, match=r"^not for you: ask for a login$"):
        asking.sessions()
    assert paused == []


def test_the_shard_of_a_learner_that_is_busy_is_named_and_the_others_are_listed() -> None:
    asking, paused = operator(
        BUSY, listed("s0", shards=3, told=(0,)), listed("s2", shards=3, told=(2,)),
    )  # fmt: skip
    whole = asking.sessions()
    assert sorted(one.session for one in whole.sessions) == ["s0", "s2"]
    assert (whole.shards, whole.told, untold(whole)) == (3, (0, 2), (1,))
    assert paused == []


def test_a_learner_whose_pages_lead_nowhere_is_told_instead_of_asked_for_ever() -> None:
    asking, _ = operator(listed("s1", older=5))
    with pytest.raises(OperatorError, match=r"leads back\): is it of this version\?$"):
        asking.sessions()


def test_a_learner_that_restarts_between_two_pages_is_asked_again() -> None:
    hub = MemoryHub(inline=True)
    answers: list[SessionList | bytes] = [listed("s2", older=1), BUSY, listed("s1")]
    asked: list[int] = []

    def serve(request: Request) -> None:
        asked.append(decode(request.payload, SessionQuery).leave_out)
        answering(answers.pop(0))(request)

    MemoryBus(hub).serve(KEYS.learner("list"), serve, shared=True)
    paused: list[float] = []
    whole = Operator(MemoryBus(hub), KEYS, pause=paused.append).sessions()
    assert [one.session for one in whole.sessions] == ["s1", "s2"]
    assert (asked, len(paused), untold(whole)) == ([0, 1, 1], 1, ())


@pytest.mark.parametrize("lost", [0, 2])
def test_a_reply_that_is_lost_on_its_way_makes_no_learner_absent(lost: int) -> None:
    hub = MemoryHub(inline=True)
    pages = {
        0: {0: listed("a2", shards=2, told=(0,), older=2), 2: listed("a1", shards=2, told=(0,))},
        1: {0: listed("b2", shards=2, told=(1,), older=3), 2: listed("b1", shards=2, told=(1,))},
    }
    asked: list[tuple[int, int]] = []

    def learner(shard: int) -> Callable[[Request], None]:
        def serve(request: Request) -> None:
            leave_out = decode(request.payload, SessionQuery).leave_out
            asked.append((shard, leave_out))
            if shard == 0 or leave_out != lost or asked.count((1, lost)) > 1:
                request.reply(encode(pages[shard][leave_out]))

        return serve

    for shard in pages:
        MemoryBus(hub).serve(KEYS.learner("list"), learner(shard), shared=True)
    whole = Operator(MemoryBus(hub), KEYS).sessions()
    assert sorted(one.session for one in whole.sessions) == ["a1", "a2", "b1", "b2"]
    assert untold(whole) == ()
    assert sorted(leave_out for shard, leave_out in asked if shard == 1) == sorted([0, 2, lost])


def test_a_learner_known_to_be_absent_is_not_waited_for_at_every_page() -> None:
    hub = MemoryHub(inline=True)
    asked: list[int] = []

    def serve(request: Request) -> None:
        asked.append(decode(request.payload, SessionQuery).leave_out)
        older = asked[-1] + 2 if asked[-1] < 6 else None
        request.reply(encode(listed(f"s{asked[-1]}", shards=2, told=(0,), older=older)))

    MemoryBus(hub).serve(KEYS.learner("list"), serve, shared=True)
    whole = Operator(MemoryBus(hub), KEYS).sessions()
    assert (asked, untold(whole), len(whole.sessions)) == ([0, 0, 2, 4, 6], (1,), 4)


def in_turn(*rounds: tuple[SessionList | None, ...]) -> tuple[Operator, list[int]]:
    """Return an operator without patience and what it leaves out; a tuple a question, a reply a learner."""
    hub = MemoryHub(inline=True)
    asked: list[int] = []

    def learner(number: int) -> Callable[[Request], None]:
        heard = iter(rounds)

        def serve(request: Request) -> None:
            if number == 0:
                asked.append(decode(request.payload, SessionQuery).leave_out)
            reply = next(heard, (None,) * len(rounds[0]))[number]
            if reply is not None:
                request.reply(encode(reply))

        return serve

    for number in range(len(rounds[0])):
        MemoryBus(hub).serve(KEYS.learner("list"), learner(number), shared=True)
    return Operator(MemoryBus(hub), KEYS, patience_s=0.0), asked


@pytest.mark.parametrize("first", [0, 1])
def test_two_questions_that_one_learner_each_answers_tell_of_both(first: int) -> None:
    pages = (listed("a", shards=2, told=(0,)), listed("b", shards=2, told=(1,)))
    rounds: list[tuple[SessionList | None, ...]] = [(pages[0], None), (None, pages[1])]
    asking, asked = in_turn(*(rounds if first == 0 else rounds[::-1]))
    whole = asking.sessions()
    assert sorted(one.session for one in whole.sessions) == ["a", "b"]
    assert (asked, whole.told, untold(whole)) == ([0, 0], (0, 1), ())


def test_a_second_question_that_nobody_answers_loses_nothing_of_the_first() -> None:
    heard = listed("a", shards=2, told=(0,))
    asking, asked = in_turn((heard, None), (None, None))
    assert asking.sessions() == heard
    assert asked == [0, 0]


def test_a_second_question_is_not_repeated_where_the_learner_is_busy_by_then() -> None:
    hub = MemoryHub(inline=True)
    heard = listed("a", shards=2, told=(0,))
    answers: list[SessionList | bytes] = [heard, BUSY]

    def serve(request: Request) -> None:
        answering(answers.pop(0))(request)

    MemoryBus(hub).serve(KEYS.learner("list"), serve, shared=True)
    paused: list[float] = []
    assert Operator(MemoryBus(hub), KEYS, pause=paused.append).sessions() == heard
    assert (answers, paused) == ([], [])


def test_a_later_page_that_nobody_answers_leaves_the_lines_heard_and_calls_no_shard_told() -> None:
    asking, asked = in_turn((listed("a2", shards=2, told=(0,), older=2), listed("b2", shards=2, told=(1,))))
    whole = asking.sessions()
    assert sorted(one.session for one in whole.sessions) == ["a2", "b2"]
    assert (asked, whole.told, untold(whole), whole.older) == ([0, 2], (), (0, 1), None)


def test_only_a_shard_that_tells_every_page_is_told() -> None:
    newest = (listed("a2", shards=3, told=(0,), older=3), listed("b2", shards=3, told=(1,)), None)
    after = (listed("a1", shards=3, told=(0,)), None, listed("c1", shards=3, told=(2,)))
    asking, asked = in_turn(newest, newest, after, after)
    whole = asking.sessions()
    assert sorted(one.session for one in whole.sessions) == ["a1", "a2", "b2", "c1"]
    assert (asked, whole.told, untold(whole)) == ([0, 0, 3, 3], (0,), (1, 2))


def test_a_session_that_comes_again_on_a_later_page_is_one_line_as_it_was_first_told() -> None:
    first = listed("s1", older=1)
    moved = tuple(replace(one, phase="done") for one in first.sessions)
    asking, _ = in_turn((first,), (SessionList(sessions=(*listed("s0").sessions, *moved)),))
    assert asking.sessions().sessions == (*listed("s0").sessions, *first.sessions)
