"""What a simulated teacher says, as kernels: live teachers and batch runs share them."""

import math
from collections.abc import MutableSequence
from typing import Annotated, NamedTuple

from sfid_core.chance import below, draw, unit
from sfid_core.compiled import kernel
from sfid_core.learning.parameters import RATE, Choice, Range

_COUNT = Range(0, 1e9)
_DELAY = Range(0, 600_000, unit="ms")


class TeacherParameters(NamedTuple):
    """A simulated teacher: an oracle's knowledge, with faults and habits. The defaults have none.

    In this order a teacher may be inattentive (`silence`, `fatigue`), mistaken (`label_error`,
    `reward_error`) and sparing with praise or blame (`silence_right`, `silence_wrong`, `soften`,
    `diminishing`).
    """

    label_error: Annotated[float, RATE] = 0.0
    """Share of labels that name another action than the teacher's."""
    reward_error: Annotated[float, RATE] = 0.0
    """Share of judgements that are mistaken: what is right counts as wrong and the other way round. 1 minus
    the consistency C of Griffith et al. 2013, the error rate of Loftin et al. 2015."""
    silence: Annotated[float, RATE] = 0.0
    """Share of decisions without an answer, whatever it would be: 1 minus the probability L of feedback of
    Griffith et al. 2013. 0.3 is the mean of 26 people (Cederborg et al. 2015)."""
    silence_right: Annotated[float, RATE] = 0.0
    """Share of judgements of right that go without praise: mu+ of Loftin et al. 2015."""
    silence_wrong: Annotated[float, RATE] = 0.0
    """Share of judgements of wrong that go without blame: mu- of Loftin et al. 2015."""
    guidance_width: Annotated[int, Range(1, 64)] = 2
    """Actions that guidance points at: the one they would label and others, drawn (ours)."""
    praises: Annotated[int, Choice(("optimal", "preferred"))] = 0
    """What is right: any action that begins a shortest solution, or the one the teacher would label."""
    soften: Annotated[float, RATE] = 0.0
    """Share of blame that is turned into praise: the positive bias of people (Thomaz & Breazeal 2006)."""
    diminishing: Annotated[float, _COUNT] = 0.0
    """Praise for the n-th time in the same state and action is given with probability 1 / (1 + n / this); 0:
    praise never diminishes (form ours, after Li et al.)."""
    fatigue: Annotated[float, _COUNT] = 0.0
    """An answer after n others is given with probability exp(-n / this); 0: never tired (form ours)."""
    drift_after: Annotated[float, _COUNT] = 0.0
    """From this decision on the teacher prefers other optimal actions, and praise and blame swap their
    silence (Loftin et al. 2015 swap mu+ and mu-); 0: never."""
    delay: Annotated[int, Choice(("none", "uniform", "gamma"))] = 0
    """Time to answer: at once, uniform from `delay_min_ms` to `delay_max_ms`, or Gamma of shape 2."""
    delay_min_ms: Annotated[float, _DELAY] = 200.0
    """Shortest time to answer, with delay `uniform`."""
    delay_max_ms: Annotated[float, _DELAY] = 800.0
    """Longest time to answer, with delay `uniform`; 0.2 to 0.8 s is the window of Knox & Stone 2009."""
    delay_scale_ms: Annotated[float, _DELAY] = 280.0
    """Scale of the Gamma: 0.28 s, Knox & Stone 2009 (from memory, unverified)."""


class TeacherMemory(NamedTuple):
    """What a teacher remembers of a session."""

    scalars: MutableSequence[float]
    """0: answers given so far."""
    praised: MutableSequence[float]
    """How often each action was praised in each state, at state * actions + action; empty unless praise
    diminishes."""


TEACHER_SCALARS = 1
_POINTING = 15
"""Stream of the faults of guidance, which is asked for beside a judgement of the same decision."""
_GUIDANCE = 32
"""First stream of guidance: one for each action that is pointed at beside the label."""
_SILENCE, _ERROR, _CHOICE, _HABIT, _SOFTEN, _TIRED, _DELAY_1, _DELAY_2 = range(1, 9)
"""Streams of a teacher; 0 is their preference, 16 what they prefer after a drift."""


@kernel
def preference_key(t: TeacherParameters, key: int, decision: int) -> int:
    """Return the stream that names the teacher's favourites at a decision."""
    return draw(key, 16 if has_drifted(t, decision) else 0)


@kernel
def has_drifted(t: TeacherParameters, decision: int) -> bool:
    """Tell whether the teacher has changed their mind."""
    return (t.drift_after > 0.0) & (decision >= t.drift_after)


@kernel
def preferred_of(preference: int, word: int, optimal: int, actions: int) -> int:
    """Return the one optimal action that a teacher names in a state, always the same one; -1 without any.

    Args: preference: `preference_key`; word: 64 bits of the state's key; optimal: bit a set where action a is
    optimal.
    """
    return nth_action(optimal, below(preference, word, count_actions(optimal, actions)), actions)


@kernel
def count_actions(among: int, actions: int) -> int:
    """Return how many actions have their bit set."""
    count = 0
    for action in range(actions):
        count += (among >> action) & 1
    return count


@kernel
def nth_action(among: int, place: int, actions: int) -> int:
    """Return the place-th action (from 0) whose bit is set in `among`; -1 where there are fewer."""
    chosen = -1
    for action in range(actions):  # without branches, for no processor foretells which action it is
        has = (among >> action) & 1
        chosen = action if has & (place == 0) else chosen
        place -= has
    return chosen


@kernel
def is_silent(t: TeacherParameters, m: TeacherMemory, faults: int, decision: int) -> bool:
    """Tell whether the teacher misses what is asked, from inattention or fatigue.

    Args: faults: the key of the faults of this kind of answer.
    """
    if t.silence > 0.0 and unit(draw(faults, _SILENCE), decision) < t.silence:
        return True
    if t.fatigue > 0.0:
        return unit(draw(faults, _TIRED), decision) >= math.exp(-m.scalars[0] / t.fatigue)
    return False


@kernel
def label_of(
    t: TeacherParameters, m: TeacherMemory, key: int, decision: int, word: int, optimal: int, actions: int
) -> int:
    """Return the label for a state, or -1 for silence.

    An error names one of the actions that are not optimal, or, where all are, one that the teacher would not
    have named; with nothing else to name it is silence. Without an optimal action there is nothing to say.
    """
    return named_of(t, m, key, key, decision, word, optimal, actions)


@kernel
def named_of(
    t: TeacherParameters,
    m: TeacherMemory,
    key: int,
    faults: int,
    decision: int,
    word: int,
    optimal: int,
    actions: int,
) -> int:
    """Return what `label_of` does, with the silence and the errors that are drawn from `faults`."""
    if optimal == 0 or is_silent(t, m, faults, decision):
        return -1
    named = preferred_of(preference_key(t, key, decision), word, optimal, actions)
    if t.label_error > 0.0 and unit(draw(faults, _ERROR), decision) < t.label_error:
        among = ((1 << actions) - 1) & ~optimal
        if among == 0:
            among = optimal & ~(1 << named)
        count = count_actions(among, actions)
        if count == 0:
            return -1
        named = nth_action(among, below(draw(faults, _CHOICE), decision, count), actions)
    m.scalars[0] += 1.0
    return named


@kernel
def guidance_of(
    t: TeacherParameters, m: TeacherMemory, key: int, decision: int, word: int, optimal: int, actions: int
) -> int:
    """Return the actions worth considering, bit a set for action a; 0 is silence.

    One is what the teacher would do, or takes for it by mistake; the others are drawn. Silence and mistakes
    are not those of the judgement that follows: a teacher who points wrongly sees what comes of it.
    """
    label = named_of(t, m, key, draw(key, _POINTING), decision, word, optimal, actions)
    if label < 0:
        return 0
    bits = 1 << label
    for place in range(int(t.guidance_width) - 1):
        left = ((1 << actions) - 1) & ~bits
        count = count_actions(left, actions)
        if count == 0:
            return bits
        bits |= 1 << nth_action(left, below(draw(key, _GUIDANCE + place), decision, count), actions)
    return bits


@kernel
def reward_of(  # noqa: PLR0913, PLR0917 - what a reward depends on
    t: TeacherParameters,
    m: TeacherMemory,
    key: int,
    decision: int,
    state: int,
    word: int,
    optimal: int,
    action: int,
    actions: int,
) -> float:
    """Return +1 for an action that the teacher holds right and -1 for another; 0 is silence.

    Without an optimal action there is nothing to say.
    """
    if optimal == 0 or is_silent(t, m, key, decision):
        return 0.0
    if t.praises == 0:
        right = (optimal >> action) & 1 == 1
    else:
        right = preferred_of(preference_key(t, key, decision), word, optimal, actions) == action
    if t.reward_error > 0.0:
        right = right != (unit(draw(key, _ERROR), decision) < t.reward_error)
    if t.silence_right > 0.0 or t.silence_wrong > 0.0:
        spare = t.silence_right if right != has_drifted(t, decision) else t.silence_wrong
        if unit(draw(key, _HABIT), decision) < spare:
            return 0.0
    if t.soften > 0.0 and not right and unit(draw(key, _SOFTEN), decision) < t.soften:
        right = True
    if t.diminishing > 0.0 and right:
        at = state * actions + action
        given = m.praised[at]
        m.praised[at] += 1.0
        if unit(draw(key, _HABIT), decision) >= 1.0 / (1.0 + given / t.diminishing):
            return 0.0
    m.scalars[0] += 1.0
    return 1.0 if right else -1.0


@kernel
def mark_of(  # noqa: PLR0913, PLR0917 - as reward_of
    t: TeacherParameters,
    m: TeacherMemory,
    key: int,
    decision: int,
    state: int,
    word: int,
    optimal: int,
    action: int,
    actions: int,
) -> int:
    """Return what should have been done where the teacher holds the action wrong; -1 marks nothing."""
    if reward_of(t, m, key, decision, state, word, optimal, action, actions) >= 0.0:
        return -1
    named = preferred_of(preference_key(t, key, decision), word, optimal, actions)
    return -1 if named == action else named


@kernel
def delay_of(t: TeacherParameters, key: int, decision: int) -> float:
    """Return the time to the answer in ms."""
    if t.delay == 0:
        return 0.0
    first = unit(draw(key, _DELAY_1), decision)
    if t.delay == 1:
        return t.delay_min_ms + (t.delay_max_ms - t.delay_min_ms) * first
    second = unit(draw(key, _DELAY_2), decision)
    return -t.delay_scale_ms * (math.log(1.0 - first) + math.log(1.0 - second))
