"""Who gets which condition: blocked randomisation, and Latin squares for the order of several.

People are numbered by their consent. A block has as many people as there are orders, each order once,
shuffled by the seed: at any time no order is ahead of another by more than one.
"""

from sfid_core.chance import below, stream
from sfid_core.study.definition import Design, Study
from sfid_core.study.errors import StudyError

Order = tuple[int, ...]
"""Conditions by index, in the order in which one person meets them."""


def orders(study: Study) -> tuple[Order, ...]:
    """Return the orders that a block holds, each once."""
    count = len(study.conditions)
    if study.design is Design.BETWEEN:
        return tuple((condition,) for condition in range(count))
    return latin_square(count)


def order_of(study: Study, number: int) -> Order:
    """Return the conditions of the person with this number, 0 or more; equal arguments, equal order."""
    if number < 0:
        raise StudyError(f"participant number {number} is negative: count from 0")
    possible = orders(study)
    block, place = divmod(number, len(possible))
    return possible[_shuffled(len(possible), stream(study.seed, "study", study.name, block))[place]]


def world_seed(study: Study, number: int, period: int) -> int:
    """Return the seed of a person's world in a period, below 2^53.

    All people of a block meet the same worlds, so that conditions are compared on equal ones.
    """
    block = number // len(orders(study))
    return stream(study.seed, "world", study.name, block, period) >> 11


def latin_square(count: int) -> tuple[Order, ...]:
    """Return orders in which each condition stands once in each place, and follows each other equally often.

    The first row is 0, 1, n-1, 2, n-2, ...; every next one adds 1 modulo n. For an odd n the rows reversed
    belong to it too, 2 n in all.  Source: Williams 1949.
    """
    first = [0]
    low, high = 1, count - 1
    while low <= high:
        first.append(low)
        if low < high:
            first.append(high)
        low, high = low + 1, high - 1
    rows = tuple(tuple((cell + row) % count for cell in first) for row in range(count))
    return rows if count % 2 == 0 or count == 1 else rows + tuple(row[::-1] for row in rows)


def _shuffled(count: int, key: int) -> list[int]:
    """Return 0 to count - 1 in an order drawn from `key` (Fisher & Yates)."""
    places = list(range(count))
    for last in range(count - 1, 0, -1):
        other = below(key, last, last + 1)
        places[last], places[other] = places[other], places[last]
    return places
