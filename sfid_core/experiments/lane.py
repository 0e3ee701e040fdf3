"""One lane of a batch: a session of one seed as a kernel over tables, from its first episode to its last.

What differs between sessions by more than numbers is a part that `batch` puts in the place of a stand-in
here: the method's kernels, who is asked for what, and how many numbers a state has. Each kind of session so
becomes machine code of its own, in which loops over actions are unrolled and nothing is asked twice.
"""

from collections.abc import MutableSequence, Sequence

from sfid_core.compiled import kernel
from sfid_core.experiments.greedy import greedy_share
from sfid_core.experiments.lane_answers import nothing_after, nothing_before
from sfid_core.experiments.lane_world import (
    CAP,
    COLUMNS,
    N_ACTIONS,
    LanePlan,
    Lanes,
    LaneTeacher,
    LaneWorld,
    Scratch,
)
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
from sfid_core.teaching.kernels import TeacherParameters, preference_key, preferred_of

WIDTH = N_ACTIONS + 1
"""Stands in for the numbers that a method keeps of a state; a constant too."""


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
def keys_of(streams: Lanes, lane: int, teachers: int) -> Sequence[int]:
    """Return the keys of a lane's teachers."""
    return streams.teachers[lane * teachers : (lane + 1) * teachers]


@kernel
def key_of_one(streams: Lanes, lane: int, teachers: int) -> Sequence[int]:  # noqa: ARG001 - as keys_of
    """Return the key of a lane's only teacher: by itself it stays in a register."""
    return (streams.teachers[lane],)


@kernel
def said_before(
    world: LaneWorld,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    scratch: Scratch,
    state: int,
    decision: int,
) -> tuple[Evidence, int]:
    """Stand in for what teachers are asked before the action."""
    return nothing_before(world, teachers, keys, scratch, state, decision)


@kernel
def said_after(  # noqa: PLR0913, PLR0917 - what an answer depends on
    world: LaneWorld,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    scratch: Scratch,
    state: int,
    action: int,
    step: int,
    before: Evidence,
    decision: int,
) -> tuple[Evidence, int]:
    """Stand in for what teachers are asked after the action."""
    return nothing_after(world, teachers, keys, scratch, state, action, step, before, decision)


@kernel
def run_lanes(  # noqa: PLR0913, PLR0917 - one argument a part of the session
    world: LaneWorld,
    plan: LanePlan,
    memory: Memory,
    p: tuple[float, ...],
    teachers: tuple[LaneTeacher, ...],
    streams: Lanes,
    scratch: Scratch,
    gamma: float,
    out: MutableSequence[float],
    success: MutableSequence[float],
) -> int:
    """Run one session a lane, each from a blank memory; return the number of decisions of them all.

    Args: out: lanes * episodes * COLUMNS numbers, lane by lane; success: lanes * checkpoints numbers, the
    share of the lane's trials that the greedy policy solves after so many episodes.
    """
    m = Memory(memory.values, memory.scalars, memory.trail, N_ACTIONS, WIDTH)
    decisions = 0
    for lane in range(streams.lanes):
        blank(m.values)
        blank(m.scalars)
        blank(m.trail)
        for number in range(len(teachers)):
            blank(teachers[number].memory.scalars)
            blank(teachers[number].memory.praised)
        draws = Draws(streams.ties[lane], streams.explore[lane])
        keys = keys_of(streams, lane, len(teachers))
        decision = 0
        checked = 0
        for episode in range(plan.episodes):
            begin(m, p, episode)
            row = lane * plan.episodes + episode
            start = streams.starts[row]
            decision = run_episode(
                world, m, p, draws, teachers, keys, scratch, gamma, start, decision, out, row * COLUMNS
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
    state, first = start, decision
    learnt = inputs = agreements = as_named = outcome = 0
    errors = errors_shaped = total = total_environment = 0.0
    discount = 1.0
    while outcome == 0:
        step = decision - first
        named = preferred(world, m.actions, teachers[0].parameters, keys[0], state, decision)
        chosen = choose(m, p, draws, state, decision)
        before, heard = said_before(world, teachers, keys, scratch, state, decision)
        action = settle(m, p, draws, state, chosen, before, decision)
        t = transition(world, m.actions, state, action, step)
        outcome = world.outcome[t.next_state]
        after, judged = said_after(world, teachers, keys, scratch, state, action, step, before, decision)
        learned = learn(m, p, t, after)
        errors += abs(learned.environment)
        errors_shaped += abs(learned.shaped)
        total += discount * (t.reward + learned.h)
        total_environment += discount * t.reward
        inputs += heard + judged
        agreements += learned.h > 0.0
        as_named += action == named
        learnt += 1
        discount *= gamma
        decision += 1
        if outcome == 0 and step + 1 >= world.steps_max:
            outcome = CAP
        elif outcome == 0 and undo(p, after) == 1:
            # A step that was taken back is a second decision, without an answer and without learning.
            discount *= gamma
            decision += 1
            outcome = CAP if decision - first >= world.steps_max else 0
        else:
            state = t.next_state
    sums = (errors, errors_shaped, total, total_environment, inputs, agreements, as_named)
    write_measures(out, at, decision - first, learnt, sums, outcome, world.distance[start])
    return decision


@kernel
def preferred(
    world: LaneWorld, actions: int, teacher: TeacherParameters, key: int, state: int, decision: int
) -> int:
    """Return what a teacher would name without fault."""
    favourite = preference_key(teacher, key, decision)
    return preferred_of(favourite, world.word[state], world.optimal[state], actions)


@kernel
def transition(world: LaneWorld, actions: int, state: int, action: int, step: int) -> Transition:
    """Return what comes of an action."""
    place = state * actions + action
    after = world.successor[place]
    ended = world.outcome[after] > 0
    here, there = world.distance[state], world.distance[after]
    return Transition(state, action, world.reward[place], after, ended, step, here, there, 0.0)


@kernel
def write_measures(
    out: MutableSequence[float],
    at: int,
    steps: int,
    learnt: int,
    sums: tuple[float, float, float, float, int, int, int],
    outcome: int,
    optimal_steps: int,
) -> None:
    """Write a row of `lane_world.MEASURES` to `out` from `at` on; `learnt` is the number of steps kept."""
    out[at] = steps
    out[at + 1] = sums[0] / learnt
    out[at + 2] = sums[1] / learnt
    out[at + 3] = sums[2]
    out[at + 4] = sums[3]
    out[at + 5] = sums[4]
    out[at + 6] = sums[5]
    out[at + 7] = outcome
    out[at + 8] = optimal_steps
    out[at + 9] = sums[6] / learnt


@kernel
def blank(numbers: MutableSequence[float]) -> None:
    """Set every number to 0."""
    for place in range(len(numbers)):
        numbers[place] = 0.0
