"""What a simulated teacher says, as kernels: live teachers and batch runs share them."""

from collections.abc import MutableSequence
from typing import Annotated, NamedTuple

from sfid_core.chance import below, draw, unit
from sfid_core.compiled import kernel
from sfid_core.learning.parameters import RATE


class TeacherParameters(NamedTuple):
    """A simulated teacher: knows the optimal actions, errs and is silent at rates. Silence is drawn first."""

    label_error: Annotated[float, RATE] = 0.0
    """Share of labels that name another action than the teacher's."""
    reward_error: Annotated[float, RATE] = 0.0
    """Share of rewards whose sign is flipped."""
    silence: Annotated[float, RATE] = 0.0
    """Share of decisions without an opinion."""


class TeacherMemory(NamedTuple):
    """What a teacher remembers of a session."""

    scalars: MutableSequence[float]
    """0: answers given so far."""


TEACHER_SCALARS = 1


@kernel
def preferred_of(key: int, word: int, optimal: int, actions: int) -> int:
    """Return the one optimal action that this teacher names in a state, always the same one; -1 without any.

    Args: key: the teacher; word: 64 bits of the state's key; optimal: bit a set where action a is optimal.
    """
    count = 0
    for action in range(actions):
        count += (optimal >> action) & 1
    if count == 0:
        return -1
    place = 0
    if count > 1:
        place = below(draw(key, 0), word, count)
    return nth_action(optimal, place, actions)


@kernel
def nth_action(among: int, place: int, actions: int) -> int:
    """Return the place-th action (from 0) whose bit is set in `among`; -1 where there are fewer."""
    for action in range(actions):
        if (among >> action) & 1:
            if place == 0:
                return action
            place -= 1
    return -1


@kernel
def label_of(
    t: TeacherParameters, m: TeacherMemory, key: int, decision: int, word: int, optimal: int, actions: int
) -> int:
    """Return the label for a state, or -1 for silence.

    An error names one of the actions that are not optimal, or, where all are, one that the teacher would not
    have named; with nothing else to name it is silence. Without an optimal action there is nothing to say.
    """
    if optimal == 0 or (t.silence > 0.0 and unit(draw(key, 1), decision) < t.silence):
        return -1
    named = preferred_of(key, word, optimal, actions)
    if t.label_error > 0.0 and unit(draw(key, 2), decision) < t.label_error:
        among = ((1 << actions) - 1) & ~optimal
        if among == 0:
            among = optimal & ~(1 << named)
        count = 0
        for action in range(actions):
            count += (among >> action) & 1
        if count == 0:
            return -1
        named = nth_action(among, below(draw(key, 3), decision, count), actions)
    m.scalars[0] += 1.0
    return named


@kernel
def reward_of(
    t: TeacherParameters, m: TeacherMemory, key: int, decision: int, optimal: int, action: int
) -> float:
    """Return +1 where the action is an optimal one and -1 where not, flipped by an error; 0 is silence."""
    if optimal == 0 or (t.silence > 0.0 and unit(draw(key, 1), decision) < t.silence):
        return 0.0
    right = (optimal >> action) & 1 == 1
    if t.reward_error > 0.0 and unit(draw(key, 2), decision) < t.reward_error:
        right = not right
    m.scalars[0] += 1.0
    return 1.0 if right else -1.0
