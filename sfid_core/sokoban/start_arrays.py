"""The starts of many seeds at once: draw for draw those of `sfid_core.sokoban.starts`."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sfid_core.chance_array import Words, belows, streams
from sfid_core.sokoban.starts import BALANCED_MAX, StartKind, StartOrder, WorldError, drawn_among

TOGETHER_MAX = 64
"""Draws up to which seeds are served together; more go seed by seed, for the work grows with the square."""

Ids = npt.NDArray[np.int64]


def start_indexes(keys: Sequence[int], kind: StartKind, count: int, episodes: int) -> Ids:
    """Return int64 [n_keys, episodes]: `StartOrder(count, kind, key).index(episode)` of each."""
    if count == 1:
        return np.zeros((len(keys), episodes), dtype=np.int64)
    if kind is StartKind.ALL or count > BALANCED_MAX:
        words = streams(keys, "start")
        return belows(words[:, np.newaxis], np.arange(episodes), count)
    if count > TOGETHER_MAX:
        orders = [StartOrder(count, kind, key) for key in keys]
        rows = [[order.index(episode) for episode in range(episodes)] for order in orders]
        return np.array(rows, dtype=np.int64).reshape(len(keys), episodes)
    blocks = -(-episodes // count)
    words = np.stack([streams(keys, "start", block) for block in range(blocks)], axis=1)
    return drawn_together(words.reshape(-1), count, count).reshape(len(keys), blocks * count)[:, :episodes]


def sampled_ids(keys: Sequence[int], pool: Ids, own: int, count: int) -> Ids:
    """Return int64 [n_keys, count]: the ids that `start_ids` draws for a SAMPLE of each key."""
    if count > len(pool):
        message = f"starts: {count} asked for, but the level has only {len(pool)} that can be solved"
        raise WorldError(message)
    others = pool[pool != own]
    words = streams(keys, "sample")
    if count - 1 > TOGETHER_MAX:
        rows = [drawn_among(word, len(others), count - 1) for word in words.tolist()]
        drawn = np.array(rows, dtype=np.int64).reshape(len(keys), count - 1)
    else:
        drawn = drawn_together(words, len(others), count - 1)
    ids = np.full((len(keys), count), own, dtype=np.int64)
    ids[:, 1:] = others[drawn]
    return ids


def drawn_together(words: Words, n: int, count: int) -> Ids:
    """Return int64 [n_words, count]: `drawn_among(word, n, count)` of each word."""
    drawn = np.empty((len(words), count), dtype=np.int64)
    moved: list[tuple[Ids, Ids]] = []
    for place in range(count):
        other = place + belows(words, place, n - place)
        drawn[:, place] = _looked_up(other, moved)
        moved.append((other, _looked_up(np.full(len(words), place, dtype=np.int64), moved)))
    return drawn


def _looked_up(places: Ids, moved: list[tuple[Ids, Ids]]) -> Ids:
    """Return what stands at each row's place after the moves, the latest of which counts."""
    values = places
    for place, value in moved:
        values = np.where(places == place, value, values)
    return values
