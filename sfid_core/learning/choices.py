"""Ways to pick an action that several methods share."""

from typing import Any

from sfid_core.chance import below, unit
from sfid_core.compiled import kernel
from sfid_core.learning.elementary import exp
from sfid_core.learning.kernels import Draws, Memory, choose_first_block


@kernel
def explored(m: Memory, explore: float, draws: Draws, decision: int, chosen: int) -> int:
    """Return the chosen action, with probability `explore` any action."""
    if explore > 0.0 and unit(draws.explore, decision) < explore:
        return below(draws.ties, decision, m.actions)
    return chosen


@kernel
def choose_explored(m: Memory, p: Any, draws: Draws, state: int, decision: int) -> int:  # noqa: ANN401 - any method's
    """Return an action with the largest value, ties at random; with probability `p.explore` any action."""
    if p.explore > 0.0 and unit(draws.explore, decision) < p.explore:
        return below(draws.ties, decision, m.actions)
    return choose_first_block(m, p, draws, state, decision)


@kernel
def most_in_block(m: Memory, draws: Draws, state: int, decision: int, block: int) -> int:
    """Return an action with the largest number of one block of a state, ties at random."""
    return most_blended(m, draws, state, decision, block, block, 0.0)


@kernel
def most_blended(
    m: Memory, draws: Draws, state: int, decision: int, block: int, other: int, weight: float
) -> int:
    """Return an action with the largest block + weight * other block of a state, ties at random."""
    at = state * m.width + block * m.actions
    beside = state * m.width + other * m.actions
    largest = m.values[at] + weight * m.values[beside]
    tied = 1
    for action in range(1, m.actions):
        value = m.values[at + action] + weight * m.values[beside + action]
        if value > largest:
            largest = value
            tied = 1 << action
        elif value == largest:
            tied |= 1 << action
    return one_of(tied, draws.ties, decision, m.actions)


@kernel
def best_among(m: Memory, key: int, state: int, among: int, decision: int) -> int:
    """Return an action with the largest value of the first block whose bit is set, ties drawn from `key`.

    Args: among: at least one bit of an action is set.
    """
    at = state * m.width
    largest = 0.0
    tied = 0
    for action in range(m.actions):
        if (among >> action) & 1:
            value = m.values[at + action]
            if tied == 0 or value > largest:
                largest = value
                tied = 1 << action
            elif value == largest:
                tied |= 1 << action
    return one_of(tied, key, decision, m.actions)


@kernel
def one_of(tied: int, key: int, counter: int, actions: int) -> int:
    """Return one of the actions whose bit is set, drawn evenly from `key` where there are several."""
    count = 0
    chosen = 0
    for action in range(actions):
        if (tied >> action) & 1:
            count += 1
            chosen = action
    if count < 2:
        return chosen
    place = below(key, counter, count)
    for action in range(actions):
        if (tied >> action) & 1:
            if place == 0:
                return action
            place -= 1
    return chosen


@kernel
def softmax_at(m: Memory, state: int, block: int, action: int) -> float:
    """Return the softmax probability of an action under one block of a state."""
    at = state * m.width + block * m.actions
    largest = m.values[at]
    for other in range(1, m.actions):
        largest = max(largest, m.values[at + other])
    total = 0.0
    for other in range(m.actions):
        total += exp(m.values[at + other] - largest)
    return exp(m.values[at + action] - largest) / total


@kernel
def softmax_sample(m: Memory, draws: Draws, state: int, decision: int, block: int) -> int:
    """Return an action drawn with the softmax probabilities of one block of a state."""
    at = state * m.width + block * m.actions
    largest = m.values[at]
    for action in range(1, m.actions):
        largest = max(largest, m.values[at + action])
    total = 0.0
    for action in range(m.actions):
        total += exp(m.values[at + action] - largest)
    rest = unit(draws.explore, decision) * total
    for action in range(m.actions - 1):
        rest -= exp(m.values[at + action] - largest)
        if rest < 0.0:
            return action
    return m.actions - 1
