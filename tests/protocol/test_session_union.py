"""The list of all sessions, page by page: nothing is passed over and nothing comes twice."""

from collections.abc import Callable, Iterator
from itertools import islice

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.codec import PAYLOAD_MAX, DecodeError, decode, encode, pack, unpack
from protocol.messages import SessionList, SessionQuery, SessionSummary
from protocol.session_union import left_out, list_query, page, union, union_page, untold
from tests.protocol.samples import SUMMARY

LONG = "\N{SNOWMAN}" * 512
"""A level's name of 1.5 KB: 37 of these sessions fit in a message."""

School = list[list[str]]
"""The names of each shard's sessions, the latest last."""
Joined = Callable[[list[bytes], int], SessionList]


def summary(name: str) -> SessionSummary:
    """Return a session's line: short in shard 1, whose pages reach further back than those of others."""
    level_name = "room" if name.startswith("shard1-") else LONG
    return msgspec.structs.replace(SUMMARY, session=name, level_name=level_name)


def names(listed: SessionList) -> list[str]:
    return [one.session for one in listed.sessions]


def school(*sizes: int) -> School:
    return [[f"shard{shard}-{number}" for number in range(size)] for shard, size in enumerate(sizes)]


def replies(learners: School, leave_out: int) -> list[bytes]:
    """Return what the learners of these sessions reply to one question."""
    told = []
    for shard, held in enumerate(learners):
        after = islice(reversed(held), left_out(leave_out, shard, len(learners)), None)
        told.append(encode(page(map(summary, after), leave_out, shard, len(learners))))
    return told


def walked(learners: School, joined: Joined, between: Callable[[int], None]) -> Iterator[SessionList]:
    """Yield every page until there are no older ones; `between` is called with its number after each."""
    leave_out: int | None = 0
    number = 0
    while leave_out is not None:
        told = replies(learners, leave_out)
        assert all(len(payload) <= PAYLOAD_MAX for payload in told)
        listed = joined(told, leave_out)
        assert listed.older is None or listed.older > leave_out
        yield listed
        between(number)
        leave_out, number = listed.older, number + 1


def everything(learners: School, joined: Joined, between: Callable[[int], None]) -> list[str]:
    return [name for listed in walked(learners, joined, between) for name in names(listed)]


def stands_still(_: int) -> None:
    """Nothing is created between two pages."""


@pytest.mark.parametrize("joined", [union, union_page])
@pytest.mark.parametrize(
    "sizes",
    [
        (0,),
        (1,),
        (37,),
        (38,),
        (200,),
        (0, 0),
        (100, 0, 3),
        (36, 37, 38),
        (1, 120),
        (90, 5, 90, 37),
        (60, 600, 80),
    ],
)
def test_pages_hold_every_session_of_every_learner_exactly_once(
    joined: Joined, sizes: tuple[int, ...]
) -> None:
    learners = school(*sizes)
    listed = everything(learners, joined, stands_still)
    assert len(listed) == sum(sizes)
    assert set(listed) == {name for held in learners for name in held}


@pytest.mark.parametrize("sizes", [(100,), (100, 0, 3), (36, 50, 38), (60, 600, 80)])
def test_a_page_that_is_handed_on_fits_and_the_next_begins_right_behind_it(sizes: tuple[int, ...]) -> None:
    learners = school(*sizes)
    pages = list(walked(learners, union_page, stands_still))
    assert all(len(encode(listed)) <= PAYLOAD_MAX for listed in pages)
    latest_first = [name for listed in pages for name in reversed(names(listed))]
    ranks = range(max(sizes))
    assert latest_first == [held[-1 - rank] for rank in ranks for held in learners if rank < len(held)]
    assert [listed.older is None for listed in pages] == [*[False] * (len(pages) - 1), True]
    assert len(pages) > 1


@given(
    sizes=st.lists(st.integers(0, 90), min_size=1, max_size=4),
    made=st.lists(st.lists(st.integers(0, 3), max_size=40), max_size=6),
    handed_on=st.booleans(),
)
@settings(max_examples=40, deadline=None)
def test_sessions_created_between_two_pages_make_none_be_passed_over(
    sizes: list[int], made: list[list[int]], *, handed_on: bool
) -> None:
    learners = school(*sizes)
    before = {name for held in learners for name in held}

    def create(number: int) -> None:
        for shard in made[number] if number < len(made) else ():
            held = learners[shard % len(learners)]
            held.append(f"new{number}-{len(held)}")

    listed = everything(learners, union_page if handed_on else union, create)
    assert before <= set(listed) <= {name for held in learners for name in held}


def test_a_list_says_whose_sessions_it_holds_and_whose_are_lacking() -> None:
    told = replies(school(2, 1, 2), 0)
    assert untold(union(told)) == ()
    assert untold(union([told[2], told[0]])) == (1,)
    assert union([told[2], told[0]]) == SessionList(
        sessions=tuple(map(summary, ("shard2-0", "shard0-0", "shard2-1", "shard0-1"))), shards=3, told=(0, 2)
    )
    assert untold(SessionList(sessions=())) == ()


@pytest.mark.parametrize("order", [1, -1])
def test_the_most_shards_that_a_learner_knows_of_are_those_that_must_be_told(order: int) -> None:
    few, many = (encode(SessionList(sessions=(), shards=n, told=(n - 1,))) for n in (1, 3))
    whole = union([few, many][::order])
    assert (whole.shards, whole.told, untold(whole)) == (3, (0, 2), (1,))


def test_two_learners_who_tell_of_one_session_make_one_line_of_it() -> None:
    both = [encode(SessionList(sessions=(summary("s1"), summary("s2")), shards=2, told=(n,))) for n in (0, 1)]
    assert sorted(names(union(both))) == ["s1", "s2"]


@pytest.mark.parametrize("older", [0, 6, 7])
def test_a_list_whose_next_page_leads_back_is_refused(older: int) -> None:
    told = [
        encode(SessionList(sessions=(), older=None)),
        encode(SessionList(sessions=(SUMMARY,), older=older)),
    ]
    with pytest.raises(DecodeError, match="`older` of a list behind 7 leads back"):
        union(told, 7)
    assert union([encode(SessionList(sessions=(SUMMARY,), older=8))], 7).older == 8


def test_nothing_at_all_asks_for_the_latest_and_what_cannot_be_read_is_refused() -> None:
    assert list_query(b"") == SessionQuery()
    assert list_query(encode(SessionQuery(leave_out=5))).leave_out == 5
    for wrong in (-1, 1.5, "5", None, 2**53):
        with pytest.raises(DecodeError, match="leave_out"):
            list_query(pack(unpack(encode(SessionQuery())) | {"leave_out": wrong}))


def test_questions_and_lists_without_the_newer_fields_are_read_as_before() -> None:
    query, listed = unpack(encode(SessionQuery(session="s1"))), unpack(encode(SessionList(sessions=())))
    del query["leave_out"], listed["older"], listed["shards"], listed["told"]
    assert decode(pack(query), SessionQuery) == SessionQuery(session="s1")
    assert decode(pack(listed), SessionList) == SessionList(sessions=(), older=None, shards=1, told=(0,))
