"""One list of sessions out of those that several learners give of theirs."""

from collections.abc import Iterable
from itertools import zip_longest

from protocol.codec import PAYLOAD_MAX, decode, encode
from protocol.messages import SessionList, SessionSummary

LIST_BYTES_MAX = PAYLOAD_MAX - 1_024
"""A longer list would be dropped in silence on its way: some 300 sessions fit."""


def union(payloads: Iterable[bytes]) -> SessionList:
    """Return all sessions of encoded lists, the latest of each last; DecodeError where one cannot be read."""
    lists = [decode(payload, SessionList).sessions for payload in payloads]
    if len(lists) == 1:
        return SessionList(sessions=lists[0])
    latest_first = [one for rank in zip_longest(*map(reversed, lists)) for one in rank if one is not None]
    return SessionList(sessions=tuple(reversed(latest_first)))


def fitting(latest_first: Iterable[SessionSummary]) -> SessionList:
    """Return a list that fits in a message, the latest last; older sessions that do not fit are left out."""
    chosen: list[SessionSummary] = []
    size = 0
    for summary in latest_first:
        size += len(encode(summary))
        if size > LIST_BYTES_MAX:
            break
        chosen.append(summary)
    return SessionList(sessions=tuple(reversed(chosen)))
