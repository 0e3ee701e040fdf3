"""One list of sessions out of those that several learners give of theirs, page by page.

Each session has a place: the latest of shard 0, the latest of shard 1 and so on have the first ones, then
comes the second latest of each. With one shard that is the number of newer sessions. A place grows while
sessions are created and never shrinks, also when another learner takes the shard up. So one number, the
places to leave out, is a cursor for all learners who hear a question: nothing comes to lie before it unheard.
"""

from collections.abc import Iterable, Sequence
from itertools import count

from msgspec.structs import replace

from protocol.codec import PAYLOAD_MAX, DecodeError, DecodeFault, decode, encode
from protocol.messages import SessionList, SessionQuery, SessionSummary

LIST_BYTES_MAX = PAYLOAD_MAX - 4_096
"""Of sessions in a message: a longer list would be dropped in silence on its way. Some 440 fit; the rest is
for the numbers of up to 1,024 shards."""

Placed = tuple[int, SessionSummary]


def list_query(payload: bytes) -> SessionQuery:
    """Return what is asked of the list; an empty payload asks for the latest. Raises: DecodeError."""
    return decode(payload, SessionQuery) if payload else SessionQuery()


def left_out(places: int, shard: int, shards: int) -> int:
    """Return how many of a shard's sessions, from the latest, are on the first `places` places."""
    return max(0, -((shard - places) // shards))


def page(latest_first: Iterable[SessionSummary], leave_out: int, shard: int, shards: int) -> SessionList:
    """Return as much of a shard's list as fits in a message.

    Args: latest_first: the sessions of the shard without those on the first `leave_out` places.
    """
    listed = zip(_places(leave_out, shard, shards), latest_first, strict=False)
    return _fitting(listed, SessionList(sessions=(), shards=shards, told=(shard,)))


def union(payloads: Iterable[bytes], leave_out: int = 0) -> SessionList:
    """Return the encoded lists that several replied to one question as one, the latest last, each once.

    What lies behind the beginning of the next page is left to that page. Raises: DecodeError where a list
    cannot be read, or its next page would not lead on.
    """
    listed, whole = _joined(payloads, leave_out)
    return _with(whole, [summary for _, summary in listed])


def union_page(payloads: Iterable[bytes], leave_out: int = 0) -> SessionList:
    """Return as much of `union` as fits in a message. Raises: DecodeError, as there."""
    return _fitting(*_joined(payloads, leave_out))


def untold(whole: SessionList) -> tuple[int, ...]:
    """Return the shards whose sessions a list does not tell of."""
    return tuple(sorted(set(range(whole.shards)) - set(whole.told)))


def _joined(payloads: Iterable[bytes], leave_out: int) -> tuple[list[Placed], SessionList]:
    """Return the sessions of a page with their places, the latest first, and the page but for them."""
    lists = [decode(payload, SessionList) for payload in payloads]
    nexts = [each.older for each in lists if each.older is not None]
    if min(nexts, default=leave_out + 1) <= leave_out:
        raise DecodeError(DecodeFault.NOT_THE_SCHEMA, f"`older` of a list behind {leave_out} leads back")
    older = min(nexts, default=None)
    placed: dict[str, Placed] = {}
    for each in lists:
        for place, summary in zip(_places(leave_out, *_of(each)), reversed(each.sessions), strict=False):
            if older is None or place < older:
                placed.setdefault(summary.session, (place, summary))
    told = {shard for each in lists for shard in each.told}
    shards = max((each.shards for each in lists), default=1)
    head = SessionList(sessions=(), older=older, shards=shards, told=tuple(sorted(told)))
    return sorted(placed.values(), key=lambda one: one[0]), head


def _places(leave_out: int, shard: int, shards: int) -> Iterable[int]:
    return count(left_out(leave_out, shard, shards) * shards + shard, shards)


def _of(listed: SessionList) -> tuple[int, int]:
    """Return the shard and the number of shards by which a list counts places.

    One that tells of several shards was joined from theirs, and comes alone: its order is all that counts.
    """
    return (listed.told[0], listed.shards) if len(listed.told) == 1 else (0, 1)


def _fitting(latest_first: Iterable[Placed], head: SessionList) -> SessionList:
    chosen: list[SessionSummary] = []
    size = 0
    for place, summary in latest_first:
        size += len(encode(summary))
        if size > LIST_BYTES_MAX:
            return _with(replace(head, older=place), chosen)
        chosen.append(summary)
    return _with(head, chosen)


def _with(head: SessionList, latest_first: Sequence[SessionSummary]) -> SessionList:
    return replace(head, sessions=tuple(reversed(latest_first)))
