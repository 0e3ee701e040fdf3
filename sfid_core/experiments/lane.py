"""One lane of a batch: a session of one seed as a kernel over tables, from its first episode to its last."""

from collections.abc import MutableSequence, Sequence

from sfid_core.compiled import kernel
from sfid_core.experiments.greedy import greedy_share
from sfid_core.experiments.lane_answers import said_after, said_before
from sfid_core.experiments.lane_world import CAP, COLUMNS, LanePlan, Lanes, LaneTeacher, LaneWorld, Scratch
from sfid_core.learning.kernels import (
    Draws,
    Evidence,
    Learned,
    Memory,
    Transition,
    choose_first_block,
    keep_action,
    keep_step,
    nothing,
)
from sfid_core.teaching.kernels import preference_key, preferred_of


@kernel
def choose(m: Memory, p: tuple[float, ...], draws: Draws, state: int, decision: int) -> int:
    """Stand in for a method's own; `compiled` and `linked` put that here."""
    return choose_first_block(m, p, draws, state, decision)


@kernel
def settle(
    m: Memory,
    p: tuple[float, ...],
    draws: Draws,
    state: int,
    action: int,
    evidence: Evidence,
    decision: int,
) -> int:
    """Stand in for a method's own."""
    return keep_action(m, p, draws, state, action, evidence, decision)


@kernel
def learn(m: Memory, p: tuple[float, ...], t: Transition, e: Evidence) -> Learned:  # noqa: ARG001
    """Stand in for a method's own."""
    return Learned(0.0, 0.0, 0.0)


@kernel
def undo(p: tuple[float, ...], evidence: Evidence) -> int:
    """Stand in for a method's own."""
    return keep_step(p, evidence)


@kernel
def begin(m: Memory, p: tuple[float, ...], episode: int) -> None:
    """Stand in for a method's own."""
    nothing(m, p, episode)


@kernel
def run_lanes(  # noqa: PLR0913, PLR0917 - one argument a part of the session
    world: LaneWorld,
    plan: LanePlan,
    m: Memory,
    p: tuple[float, ...],
    teachers: tuple[LaneTeacher, ...],
    streams: Lanes,
    scratch: Scratch,
    gamma: float,
    out: MutableSequence[float],
    success: MutableSequence[float],
) -> int:
    """Run one session a lane, each from a blank memory; return the number of decisions of them all.

    Args: out: lanes * episodes * COLUMNS numbers, 0 at first, lane by lane; success: lanes * checkpoints
    numbers, the share of the lane's trials that the greedy policy solves after so many episodes.
    """
    decisions = 0
    for lane in range(streams.lanes):
        blank(m.values)
        blank(m.scalars)
        blank(m.trail)
        for number in range(len(teachers)):
            blank(teachers[number].memory.scalars)
            blank(teachers[number].memory.praised)
        draws = Draws(streams.ties[lane], streams.explore[lane])
        keys = streams.teachers[lane * len(teachers) : (lane + 1) * len(teachers)]
        decision = 0
        checked = 0
        for episode in range(plan.episodes):
            begin(m, p, episode)
            row = lane * plan.episodes + episode
            start = streams.starts[row]
            decision = run_episode(
                world, plan, m, p, draws, teachers, keys, scratch, gamma, start, decision, out, row * COLUMNS
            )
            if checked < len(plan.checkpoints) and plan.checkpoints[checked] == episode + 1:
                trials = len(streams.trials) // streams.lanes
                tried = streams.trials[lane * trials : (lane + 1) * trials]
                share = greedy_share(world, m, p, tried, streams.greedy[lane], world.steps_max)
                success[lane * len(plan.checkpoints) + checked] = share
                checked += 1
        decisions += decision
    return decisions


@kernel
def run_episode(  # noqa: PLR0913, PLR0917 - as run_lanes
    world: LaneWorld,
    plan: LanePlan,
    m: Memory,
    p: tuple[float, ...],
    draws: Draws,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    scratch: Scratch,
    gamma: float,
    start: int,
    decision: int,
    out: MutableSequence[float],
    at: int,
) -> int:
    """Run an episode, write its measures to `out` from `at` on; return the number of its last decision + 1.

    Args: keys: of the teachers; start: the state it starts in; decision: the number of its first.
    """
    state = start
    steps = undone = outcome = 0
    discount = 1.0
    while outcome == 0:
        state, outcome, back = run_step(
            world, plan, m, p, draws, teachers, keys, scratch, discount, state, steps, decision, out, at
        )
        # A step that was taken back is a second decision, without an answer and without learning.
        for _ in range(1 + back):
            discount *= gamma
        steps += 1 + back
        decision += 1 + back
        undone += back
        if back and steps >= world.steps_max:
            outcome = CAP
    learnt = steps - undone
    out[at] = steps
    out[at + 1] /= learnt
    out[at + 2] /= learnt
    out[at + 7] = outcome
    out[at + 8] = world.distance[start]
    out[at + 9] /= learnt
    return decision


@kernel
def run_step(  # noqa: PLR0913, PLR0917 - as run_lanes
    world: LaneWorld,
    plan: LanePlan,
    m: Memory,
    p: tuple[float, ...],
    draws: Draws,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    scratch: Scratch,
    discount: float,
    state: int,
    steps: int,
    decision: int,
    out: MutableSequence[float],
    at: int,
) -> tuple[int, int, int]:
    """Decide, act and learn once; return the state after it, the outcome, and 1 if the step is taken back."""
    action = choose(m, p, draws, state, decision)
    before, heard = said_before(world, plan, teachers, keys, scratch, state, decision)
    action = settle(m, p, draws, state, action, before, decision)
    next_state = world.successor[state * m.actions + action]
    reward = world.reward[state * m.actions + action]
    ended = world.outcome[next_state]
    evidence, judged = said_after(
        world, plan, teachers, keys, scratch, state, action, steps, before, decision
    )
    here, there = world.distance[state], world.distance[next_state]
    transition = Transition(state, action, reward, next_state, ended > 0, steps, here, there, 0.0)
    learned = learn(m, p, transition, evidence)
    favourite = preference_key(teachers[0].parameters, keys[0], decision)
    out[at + 1] += abs(learned.environment)
    out[at + 2] += abs(learned.shaped)
    out[at + 3] += discount * (reward + learned.h)
    out[at + 4] += discount * reward
    out[at + 5] += heard + judged
    out[at + 6] += 1.0 if learned.h > 0.0 else 0.0
    preferred = preferred_of(favourite, world.word[state], world.optimal[state], m.actions)
    out[at + 9] += 1.0 if action == preferred else 0.0
    if ended > 0:
        return next_state, ended, 0
    if steps + 1 >= world.steps_max:
        return next_state, CAP, 0
    if undo(p, evidence) == 1:
        return state, 0, 1
    return next_state, 0, 0


@kernel
def blank(numbers: MutableSequence[float]) -> None:
    """Set every number to 0."""
    for place in range(len(numbers)):
        numbers[place] = 0.0
