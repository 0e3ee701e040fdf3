"""One lane of a batch: a session of one seed as a kernel over tables, from its first episode to its last."""

from collections.abc import MutableSequence, Sequence
from typing import NamedTuple

from sfid_core.chance import below
from sfid_core.compiled import kernel
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
    prefer,
)
from sfid_core.teaching.kernels import (
    TeacherMemory,
    TeacherParameters,
    guidance_of,
    label_of,
    preference_key,
    preferred_of,
    reward_of,
)

MEASURES = (
    "steps",
    "abs_td_error",
    "abs_td_error_shaped",
    "discounted_return",
    "discounted_env_return",
    "inputs",
    "agreements",
    "outcome",
    "optimal_steps",
    "preferred",
)
"""Columns of the results, one row an episode: the founding paper's measures, the code of the outcome
(`OUTCOMES`), and the share of steps on which the agent did what its first teacher prefers."""
COLUMNS = len(MEASURES)
OUTCOMES = ("running", "solved", "deadlock", "cap")
ASK_NOTHING, ASK_LABEL, ASK_REWARD, ASK_GUIDANCE, ASK_MISTAKE = range(5)


class LaneWorld(NamedTuple):
    """The world as flat tables; state s and action a are at s * actions + a."""

    successor: Sequence[int]
    reward: Sequence[float]
    outcome: Sequence[int]
    """0 running, 1 solved, 2 deadlock, by state."""
    distance: Sequence[int]
    """Fewest steps to solved by state; -1 where there is no way."""
    optimal: Sequence[int]
    """Bit a set where action a begins a shortest solution, by state."""
    word: Sequence[int]
    """64 bits of each state's key."""
    steps_max: int


class LaneTeacher(NamedTuple):
    """One simulated teacher."""

    parameters: TeacherParameters
    memory: TeacherMemory


class LanePlan(NamedTuple):
    """What a lane does."""

    episodes: int
    asks_before: int
    asks_after: int
    teachers: int
    """Number of teachers; 0 leaves the agent alone."""


class Lanes(NamedTuple):
    """What tells the lanes apart: their chance and their starts."""

    lanes: int
    ties: Sequence[int]
    """By lane, as `Draws`."""
    explore: Sequence[int]
    teachers: Sequence[int]
    """Keys of the teachers, lane by lane."""
    starts: Sequence[int]
    """States in which the episodes start, lane by lane."""


class Scratch(NamedTuple):
    """Room for one decision."""

    votes: MutableSequence[float]
    one_hot: tuple[tuple[float, ...], ...]
    """Belief in each action by label, and in none behind the last."""


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
def run_lane(  # noqa: C901, PLR0913, PLR0915, PLR0917 - one loop, told in order
    world: LaneWorld,
    plan: LanePlan,
    m: Memory,
    p: tuple[float, ...],
    draws: Draws,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    starts: Sequence[int],
    scratch: Scratch,
    gamma: float,
    out: MutableSequence[float],
    at: int,
) -> int:
    """Run a session and write its measures to `out` from `at` on; return the number of decisions.

    Args: m: zeros at first; keys: of the teachers; starts: the state in which each episode starts.
    """
    actions = m.actions
    decision = 0
    for episode in range(plan.episodes):
        begin(m, p, episode)
        state = starts[episode]
        optimal_steps = world.distance[state]
        steps = learnt = inputs = agreements = preferred = 0
        abs_environment = abs_shaped = total = env_total = 0.0
        discount = 1.0
        outcome = 0
        while outcome == 0:
            optimal = world.optimal[state]
            action = choose(m, p, draws, state, decision)
            evidence = Evidence(0, -1, scratch.one_hot[actions], 0.0, 0, -1, -1, 0.0, 0)
            if plan.teachers > 0 and plan.asks_before == ASK_LABEL:
                label, given = merged_label(world, plan, teachers, keys, scratch.votes, state, decision)
                inputs += given
                if label >= 0:
                    evidence = Evidence(1, label, scratch.one_hot[label], 0.0, 0, -1, -1, 0.0, 0)
            elif plan.teachers > 0 and plan.asks_before == ASK_GUIDANCE:
                guidance, given = merged_guidance(world, plan, teachers, keys, scratch.votes, state, decision)
                inputs += given
                if guidance != 0:
                    nowhere = scratch.one_hot[actions]
                    evidence = Evidence(1, -1, nowhere, 0.0, guidance, -1, -1, 0.0, 0)
            action = settle(m, p, draws, state, action, evidence, decision)
            next_state = world.successor[state * actions + action]
            reward = world.reward[state * actions + action]
            outcome = world.outcome[next_state]
            terminal = outcome > 0
            if not terminal and steps + 1 >= world.steps_max:
                outcome = 3
            if plan.teachers > 0 and plan.asks_after == ASK_REWARD:
                praise, given = merged_reward(world, plan, teachers, keys, state, action, actions, decision)
                inputs += given
                if praise != 0.0:
                    evidence = Evidence(
                        1, -1, scratch.one_hot[actions], praise, evidence.guidance, -1, -1, 0.0, 0
                    )
            transition = Transition(
                state,
                action,
                reward,
                next_state,
                terminal,
                steps,
                world.distance[state],
                world.distance[next_state],
                0.0,
            )
            learned = learn(m, p, transition, evidence)
            agreements += learned.h > 0.0
            favourite = preference_key(teachers[0].parameters, keys[0], decision)
            preferred += action == preferred_of(favourite, world.word[state], optimal, actions)
            abs_environment += abs(learned.environment)
            abs_shaped += abs(learned.shaped)
            total += discount * (reward + learned.h)
            env_total += discount * reward
            discount *= gamma
            steps += 1
            decision += 1
            learnt += 1
            if outcome == 0 and undo(p, evidence) == 1:
                # A decision of its own, without an answer and without learning: the world is put back.
                discount *= gamma
                steps += 1
                decision += 1
                if steps >= world.steps_max:
                    outcome = 3
            else:
                state = next_state
        out[at] = steps
        out[at + 1] = abs_environment / learnt
        out[at + 2] = abs_shaped / learnt
        out[at + 3] = total
        out[at + 4] = env_total
        out[at + 5] = inputs
        out[at + 6] = agreements
        out[at + 7] = outcome
        out[at + 8] = optimal_steps
        out[at + 9] = preferred / learnt
        at += COLUMNS
    return decision


@kernel
def run_lanes(  # noqa: PLR0913, PLR0917 - as run_lane
    world: LaneWorld,
    plan: LanePlan,
    m: Memory,
    p: tuple[float, ...],
    teachers: tuple[LaneTeacher, ...],
    streams: Lanes,
    scratch: Scratch,
    gamma: float,
    out: MutableSequence[float],
) -> int:
    """Run one session a lane, each from a blank memory; return the number of decisions of them all.

    Args: out: lanes * episodes * COLUMNS numbers, lane by lane.
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
        starts = streams.starts[lane * plan.episodes : (lane + 1) * plan.episodes]
        at = lane * plan.episodes * COLUMNS
        decisions += run_lane(world, plan, m, p, draws, teachers, keys, starts, scratch, gamma, out, at)
    return decisions


@kernel
def blank(numbers: MutableSequence[float]) -> None:
    """Set every number to 0."""
    for place in range(len(numbers)):
        numbers[place] = 0.0


@kernel
def merged_label(
    world: LaneWorld,
    plan: LanePlan,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    votes: MutableSequence[float],
    state: int,
    decision: int,
) -> tuple[int, int]:
    """Return the label most teachers name, -1 for silence or a tie, and how many named one."""
    actions = len(votes)
    word, optimal = world.word[state], world.optimal[state]
    if plan.teachers == 1:
        label = label_of(
            teachers[0].parameters, teachers[0].memory, keys[0], decision, word, optimal, actions
        )
        return label, 1 if label >= 0 else 0
    given = 0
    for action in range(actions):
        votes[action] = 0.0
    for number in range(plan.teachers):
        teacher = teachers[number]
        label = label_of(teacher.parameters, teacher.memory, keys[number], decision, word, optimal, actions)
        if label >= 0:
            votes[label] += 1.0
            given += 1
    chosen = -1
    most = 0.0
    for action in range(actions):
        if votes[action] > most:
            most = votes[action]
            chosen = action
        elif votes[action] == most:
            chosen = -1
    return chosen, given


@kernel
def merged_guidance(
    world: LaneWorld,
    plan: LanePlan,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    votes: MutableSequence[float],
    state: int,
    decision: int,
) -> tuple[int, int]:
    """Return the actions that more than half of the guiding teachers point at, and how many guide."""
    actions = len(votes)
    given = 0
    for action in range(actions):
        votes[action] = 0.0
    for number in range(plan.teachers):
        teacher = teachers[number]
        guidance = guidance_of(
            teacher.parameters,
            teacher.memory,
            keys[number],
            decision,
            world.word[state],
            world.optimal[state],
            actions,
        )
        given += guidance != 0
        for action in range(actions):
            votes[action] += (guidance >> action) & 1
    merged = 0
    for action in range(actions):
        if 2.0 * votes[action] > given:
            merged |= 1 << action
    return merged, given


@kernel
def merged_reward(
    world: LaneWorld,
    plan: LanePlan,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    state: int,
    action: int,
    actions: int,
    decision: int,
) -> tuple[float, int]:
    """Return the mean reward of the side with more votes, 0 for silence or a tie, and how many gave one."""
    praise = blame = 0.0
    for_it = against = 0
    for number in range(plan.teachers):
        teacher = teachers[number]
        given = reward_of(
            teacher.parameters,
            teacher.memory,
            keys[number],
            decision,
            state,
            world.word[state],
            world.optimal[state],
            action,
            actions,
        )
        if given > 0.0:
            praise += given
            for_it += 1
        elif given < 0.0:
            blame += given
            against += 1
    if for_it > against:
        return praise / for_it, for_it + against
    if against > for_it:
        return blame / against, for_it + against
    return 0.0, for_it + against


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
        solved += world.outcome[at] == 1
    return solved / len(starts)


@kernel
def most_preferred(m: Memory, p: tuple[float, ...], state: int, key: int, counter: int) -> int:
    """Return an action that the policy prefers most, ties at random."""
    largest = prefer(m, p, state, 0)
    chosen = 0
    ties = 1
    for action in range(1, m.actions):
        value = prefer(m, p, state, action)
        if value > largest:
            largest = value
            chosen = action
            ties = 1
        elif value == largest:
            ties += 1
    if ties > 1:
        place = below(key, counter, ties)
        for action in range(m.actions):
            if prefer(m, p, state, action) == largest:
                if place == 0:
                    return action
                place -= 1
    return chosen
