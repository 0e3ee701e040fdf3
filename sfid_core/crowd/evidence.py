"""From weights to one answer: posterior, influence cap, and when nothing is said."""

from collections.abc import Sequence
from math import exp

TIE = 1e-9
"""Two actions whose probabilities differ by less are tied: sums in another order differ by far less."""

Vote = tuple[str, int]
"""A worker's name and the action that the worker named."""


def softmax(scores: Sequence[float]) -> list[float]:
    """Return exp(score) normalised to sum 1."""
    highest = max(scores)
    grown = [exp(score - highest) for score in scores]
    total = sum(grown)
    return [value / total for value in grown]


def shares(votes: Sequence[Vote], weights: Sequence[float], actions: int) -> list[float]:
    """Return each action's share of the weight, uniform when nothing weighs; weights are 0 or more."""
    total = sum(weights)
    if total <= 0:
        return [1.0 / actions] * actions
    sums = [0.0] * actions
    for (_, action), weight in zip(votes, weights, strict=True):
        sums[action] += weight
    return [value / total for value in sums]


def leaders(posterior: Sequence[float]) -> list[int]:
    """Return the actions that are tied for the first place, one where there is no tie."""
    best = max(posterior)
    return [action for action, value in enumerate(posterior) if value >= best - TIE]


def decide(posterior: Sequence[float], abstain_below: float) -> int | None:
    """Return the most probable action; None on a tie, and below the threshold."""
    first = leaders(posterior)
    if len(first) > 1 or posterior[first[0]] < abstain_below - TIE:
        return None
    return first[0]


def influence_limit(weights: Sequence[float], newcomer: float, cap: float) -> float:
    """Return the magnitude that no weight of a decision may exceed.

    Everyone who answered counts with at least a newcomer's weight; of that total, after the cut, nobody holds
    more than the share `cap`, and nobody is cut below a newcomer. Where no more than 1 / cap people answer,
    all who are believed at least as far as a newcomer therefore weigh the same.

    Args: weights: log-odds of any sign; newcomer: weight of an unknown worker, above 0; cap: in (0, 1].
    """
    sizes = sorted((max(abs(weight), newcomer) for weight in weights), reverse=True)
    rest = sum(sizes)
    if not sizes or sizes[0] <= cap * rest:
        return sizes[0] if sizes else newcomer
    for above, size in enumerate(sizes, start=1):
        rest -= size
        below = sizes[above] if above < len(sizes) else newcomer
        if above * cap >= 1:
            break
        limit = cap * rest / (1 - above * cap)  # what `above` equal weights make of the total with the rest
        if limit >= below:
            return limit
    return newcomer
