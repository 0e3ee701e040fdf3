"""What every method's kernels work on, and the kernels that methods share.

All are named tuples of scalars and flat sequences: lists in a live session, arrays in a batch run.
"""

from collections.abc import MutableSequence, Sequence
from typing import NamedTuple

from sfid_core.chance import below
from sfid_core.compiled import kernel


class Memory(NamedTuple):
    """What a learner knows."""

    values: MutableSequence[float]
    """State s has the numbers [s * width, (s + 1) * width): blocks of one number an action, then `learnt`."""
    scalars: MutableSequence[float]
    """Numbers that belong to no state: annealed weights, counts."""
    trail: MutableSequence[float]
    """The latest steps, for methods that assign credit backwards; its columns are the method's own."""
    actions: int
    width: int
    """Numbers a state: blocks * actions + 1; the last counts the updates, 0 in a state never learnt about."""


class Draws(NamedTuple):
    """Streams of a learner's chance (`sfid_core.chance`), read at the decision's number."""

    ties: int
    explore: int


class Evidence(NamedTuple):
    """What the teachers' answers to one decision come to, all channels; `given` 0 is silence."""

    given: int = 0
    """Answers that said something."""
    label: int = -1
    """The action they would take; -1 where none was named."""
    belief: Sequence[float] = ()
    """Probability that each action is the teacher's: 1 at the label of a direct teacher, all 0 in silence."""
    reward: float = 0.0
    """Praise or blame in [-1, 1]; 0 in silence."""
    guidance: int = 0
    """Bit a set: action a is worth considering; 0 means no guidance."""
    first: int = -1
    """First step of the marked mistake, -1 where none is marked."""
    last: int = -1
    """Last step of the marked mistake."""
    delay_ms: float = 0.0
    """From the showing to the answer."""
    undo: int = 0
    """1 where the teacher wants the step taken back."""


class Transition(NamedTuple):
    """One executed step."""

    state: int
    action: int
    reward: float
    next_state: int
    terminal: bool
    """Nothing follows: no value lies beyond `next_state`. False at the step cap."""
    step: int
    """Number of the step in its episode, from 0."""
    distance: int = -1
    """Fewest steps from the state to solved; -1 where there is no way or nobody knows."""
    next_distance: int = -1
    span_ms: float = 0.0
    """How long the step was shown, for credit in real time."""


class Learned(NamedTuple):
    """What one update came to."""

    environment: float
    """TD error of Eq. 2, without the teacher; the prediction error of a method without action values."""
    shaped: float
    """TD error of Eq. 4, by which the method's values move."""
    h: float
    """The teacher's part of the reward, as the method reads the evidence; 0 is silence."""


@kernel
def best(m: Memory, state: int) -> float:
    """Return the largest value of the first block of a state."""
    at = state * m.width
    values = m.values
    largest = values[at]
    for place in range(at + 1, at + m.actions):
        value = values[place]
        if value > largest:  # noqa: PLR1730 - max() costs a call
            largest = value
    return largest


@kernel
def prefer(m: Memory, p: tuple[float, ...], state: int, action: int) -> float:  # noqa: ARG001 - the interface
    """Return how much the learner prefers an action: its value in the first block."""
    return m.values[state * m.width + action]


@kernel
def choose_first_block(m: Memory, p: tuple[float, ...], draws: Draws, state: int, decision: int) -> int:  # noqa: ARG001
    """Return an action with the largest value of the first block, ties at random.

    Source: Raza, Johnston & Williams 2016, Algorithms 1 and 2 (with Q = 0 at first, a new state gives a
    random action).
    """
    at = state * m.width
    values = m.values
    largest = values[at]
    chosen = 0
    ties = 1
    # As `choices.most_blended` of one block, tuned, for every step of most methods runs through here. Which
    # action it is, no processor can foretell: choices cost it less than branches.
    for action in range(1, m.actions):
        value = values[at + action]
        more = value > largest
        ties = 1 if more else ties + (value == largest)
        chosen = action if more else chosen
        largest = value if more else largest
    if ties == 1:
        return chosen
    place = below(draws.ties, decision, ties)
    for action in range(m.actions):
        tied = values[at + action] == largest
        chosen = action if tied & (place == 0) else chosen
        place -= tied
    return chosen


@kernel
def keep_action(
    m: Memory,  # noqa: ARG001
    p: tuple[float, ...],  # noqa: ARG001
    draws: Draws,  # noqa: ARG001
    state: int,  # noqa: ARG001
    action: int,
    evidence: Evidence,  # noqa: ARG001
    decision: int,  # noqa: ARG001
) -> int:
    """Return the action that was chosen: the teacher's answer does not steer the agent."""
    return action


@kernel
def keep_step(p: tuple[float, ...], evidence: Evidence) -> int:  # noqa: ARG001 - the interface
    """Return 0: a step is never taken back."""
    return 0


@kernel
def nothing(m: Memory, p: tuple[float, ...], episode: int) -> None:
    """Do nothing when an episode begins."""


@kernel
def one_step(m: Memory, alpha: float, gamma: float, t: Transition, h: float) -> Learned:
    """Move Q(s, a) of the first block by alpha times the shaped TD error.

    Source: Watkins & Dayan 1992; Raza, Johnston & Williams 2016, Eq. 2 and 4.
    """
    values, width = m.values, m.width
    at = t.state * width
    place = at + t.action
    ahead = 0.0 if t.terminal else best(m, t.next_state)
    environment = t.reward + gamma * ahead - values[place]
    shaped = environment + h
    values[place] += alpha * shaped
    values[at + width - 1] += 1.0
    return Learned(environment, shaped, h)
