"""What the learnt policy alone is worth, as kernels over tables."""

from collections.abc import Sequence

from sfid_core.compiled import kernel
from sfid_core.experiments.lane_world import SOLVED, LaneWorld
from sfid_core.learning.choices import one_of
from sfid_core.learning.kernels import Memory, prefer


@kernel
def greedy_share(
    world: LaneWorld, m: Memory, p: tuple[float, ...], starts: Sequence[int], key: int, steps_max: int
) -> float:
    """Return the share of `starts` from which the learnt policy alone solves within `steps_max` steps.

    The policy takes a most preferred action; a tie is broken at random, once for each state (drawn from the
    stream `key`): the policy does not learn by wandering, and one that goes in circles stays in them.
    """
    actions = m.actions
    solved = 0
    for state in starts:
        at = state
        for _ in range(steps_max):
            if world.outcome[at] != 0:
                break
            action = most_preferred(m, p, at, key, at)
            at = world.successor[at * actions + action]
        solved += world.outcome[at] == SOLVED
    return solved / len(starts)


@kernel
def most_preferred(m: Memory, p: tuple[float, ...], state: int, key: int, counter: int) -> int:
    """Return an action that the policy prefers most, ties at random."""
    largest = prefer(m, p, state, 0)
    tied = 1
    for action in range(1, m.actions):
        value = prefer(m, p, state, action)
        if value > largest:
            largest = value
            tied = 1 << action
        elif value == largest:
            tied |= 1 << action
    return one_of(tied, key, counter, m.actions)
