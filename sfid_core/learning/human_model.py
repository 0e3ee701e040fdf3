"""H(s, a): what the teacher will say about an action, learnt by regression. TAMER's part of several methods.

In real time a reward at time t is about a step that was shown during [ts, te] with the probability that the
teacher took between t - te and t - ts to answer; delays are uniform in [w0, w0 + W] (0.2 to 0.8 s):

    credit = overlap of [t - te, t - ts] and [w0, w0 + W], divided by W

Source: Knox & Stone 2009, and Knox's code for the windows; Warnell et al. 2018 for `individual`.
"""

from typing import NamedTuple

from sfid_core.compiled import kernel
from sfid_core.learning.kernels import Evidence, Memory, Transition
from sfid_core.learning.parameters import Choice, Range

CREDIT = Choice(("immediate", "previous", "aggregate", "individual"), source="Knox's code")
"""Which steps a reward is for.

immediate: the step it was asked about (turn by turn, the window long enough). previous: the step before
(Knox's slow Tetris). aggregate: sum of h * credit is the one sample of a step, once its window has passed.
individual: each reward is a sample of every step, weighed by its credit (Deep TAMER: window 200 + 3800 ms).
Steps without a duration, as in a batch run, are `immediate`.
"""
SILENCE = Choice(("skip", "zero", "decay"))
"""What a step without an answer teaches: nothing (Li et al.), a sample of 0 (Knox's default), or to forget
(Loftin's COBOT: H(s, a) -= forget * H(s, a))."""
WINDOW_FROM = Range(0, 60_000, unit="ms", source="Knox's code: 200")
WINDOW_SPAN = Range(0, 60_000, above=True, unit="ms", source="Knox's code: 600")

IMMEDIATE, PREVIOUS, AGGREGATE, INDIVIDUAL = range(4)
SKIP, ZERO, DECAY = range(3)
CELL, SPAN, SUM = range(3)
"""Columns of the trail: where H(s, a) is, how long the step was shown in ms, the sum of h * credit."""
TRAIL_COLUMNS = 3
FIRST_OPEN, STEPS = range(2)
"""Scalars: the first step whose sample is still open, and the steps of the episode so far (with `previous`:
the cell of the step before, plus 1)."""
MODEL_SCALARS = 2
DONE = -1.0
"""In place of a cell: the step had no duration and is dealt with."""
USED_MIN = 0.5
"""A step cut off by the end of its episode counts if more than this of its credit could have come (Knox)."""


class HumanModel(NamedTuple):
    """How H is learnt."""

    block: int
    """The block of the values that holds H."""
    alpha: float
    credit: int
    from_ms: float
    span_ms: float
    silence: int
    forget: float


@kernel
def hear(m: Memory, h: HumanModel, t: Transition, e: Evidence) -> float:
    """Learn from what was said about one step; return h - H(s, a), 0 in silence."""
    cell = t.state * m.width + h.block * m.actions + t.action
    error = e.reward - m.values[cell] if e.given else 0.0
    if h.credit == PREVIOUS:
        before = int(m.scalars[STEPS]) - 1
        m.scalars[STEPS] = cell + 1.0
        if before >= 0:
            sample(m, h, before, e.reward, e.given)
    elif h.credit == IMMEDIATE:
        sample(m, h, cell, e.reward, e.given)
    else:
        hear_in_time(m, h, t, e, cell)
    return error


@kernel
def hear_in_time(m: Memory, h: HumanModel, t: Transition, e: Evidence, cell: int) -> None:
    """Put a step on the trail, and give what was said to the steps that it may be about."""
    at = t.step * TRAIL_COLUMNS
    timed = t.span_ms > 0.0
    m.trail[at + CELL] = cell if timed else DONE
    m.trail[at + SPAN] = t.span_ms
    m.trail[at + SUM] = 0.0
    m.scalars[STEPS] = t.step + 1.0
    if not timed:
        sample(m, h, cell, e.reward, e.given)
    elif e.given:
        spread(m, h, t.step, e)
    elif h.credit == INDIVIDUAL:
        sample(m, h, cell, 0.0, 0)
    if h.credit == AGGREGATE:
        close_passed(m, h, t.step)


@kernel
def sample(m: Memory, h: HumanModel, cell: int, label: float, given: int) -> None:
    """Move one H(s, a) towards a label, or as silence says."""
    if given:
        m.values[cell] += h.alpha * (label - m.values[cell])
    elif h.silence == ZERO:
        m.values[cell] += h.alpha * (0.0 - m.values[cell])
    elif h.silence == DECAY:
        m.values[cell] -= h.forget * m.values[cell]
    else:
        return
    m.values[(cell // m.width + 1) * m.width - 1] += 1.0


@kernel
def spread(m: Memory, h: HumanModel, step: int, e: Evidence) -> None:
    """Give a reward to the steps that it may be about; it came `delay_ms` after the last one was shown."""
    longest = h.from_ms + h.span_ms
    starts_ms = 0.0
    while step >= 0:
        at = step * TRAIL_COLUMNS
        far = e.delay_ms - starts_ms
        near = far - m.trail[at + SPAN]
        if near >= longest:
            return
        overlap = min(far, longest) - max(near, h.from_ms)
        if overlap > 0.0:
            credit = overlap / h.span_ms
            cell = int(m.trail[at + CELL])
            if h.credit == AGGREGATE:
                m.trail[at + SUM] += e.reward * credit
            else:
                m.values[cell] += h.alpha * credit * (e.reward - m.values[cell])
                m.values[(cell // m.width + 1) * m.width - 1] += 1.0
        step -= 1
        if step >= 0:
            starts_ms -= m.trail[step * TRAIL_COLUMNS + SPAN]


@kernel
def close_passed(m: Memory, h: HumanModel, step: int) -> None:
    """Sample every open step that no reward can be about any more; `step` has just ended."""
    gap_ms = 0.0
    first = int(m.scalars[FIRST_OPEN])
    passed = step
    while passed >= first and gap_ms < h.from_ms + h.span_ms:
        gap_ms += m.trail[passed * TRAIL_COLUMNS + SPAN]
        passed -= 1
    for number in range(first, passed + 1):
        total = m.trail[number * TRAIL_COLUMNS + SUM]
        cell = int(m.trail[number * TRAIL_COLUMNS + CELL])
        if cell >= 0:
            sample(m, h, cell, total, 1 if total != 0.0 else 0)
    m.scalars[FIRST_OPEN] = max(first, passed + 1)


@kernel
def forget_steps(m: Memory, h: HumanModel) -> None:
    """Sample the steps still open, if most of their credit could have come; forget the episode."""
    if h.credit == AGGREGATE:
        gap_ms = 0.0
        first = int(m.scalars[FIRST_OPEN])
        step = int(m.scalars[STEPS]) - 1
        while step >= first:
            at = step * TRAIL_COLUMNS
            span_ms = m.trail[at + SPAN]
            cell = int(m.trail[at + CELL])
            used = (arrived(h, gap_ms + span_ms) - arrived(h, gap_ms)) / span_ms if cell >= 0 else 0.0
            if used > USED_MIN:
                total = m.trail[at + SUM]
                sample(m, h, cell, total / used, 1 if total != 0.0 else 0)
            gap_ms += span_ms
            step -= 1
    m.scalars[FIRST_OPEN] = 0.0
    m.scalars[STEPS] = 0.0


@kernel
def arrived(h: HumanModel, lag_ms: float) -> float:
    """Return the integral from 0 to `lag_ms` of the probability that an answer takes no longer than that."""
    past_ms = lag_ms - h.from_ms
    if past_ms <= 0.0:
        return 0.0
    if past_ms <= h.span_ms:
        return past_ms * past_ms / (2.0 * h.span_ms)
    return past_ms - h.span_ms / 2.0
