"""What the simulated teachers of a lane say about one decision, merged as a live session merges it."""

from collections.abc import MutableSequence, Sequence

from sfid_core.compiled import kernel
from sfid_core.experiments.lane_world import (
    ASK_GUIDANCE,
    ASK_LABEL,
    ASK_MISTAKE,
    ASK_REWARD,
    LanePlan,
    LaneTeacher,
    LaneWorld,
    Scratch,
)
from sfid_core.learning.kernels import Evidence
from sfid_core.teaching.kernels import guidance_of, label_of, mark_of, reward_of


@kernel
def said_before(
    world: LaneWorld,
    plan: LanePlan,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    scratch: Scratch,
    state: int,
    decision: int,
) -> tuple[Evidence, int]:
    """Return what the teachers say in the frozen state, and how many said something."""
    nowhere = scratch.one_hot[len(scratch.votes)]
    if plan.teachers > 0 and plan.asks_before == ASK_LABEL:
        label, given = merged_label(world, plan, teachers, keys, scratch.votes, state, decision)
        if label >= 0:
            return Evidence(1, label, scratch.one_hot[label], 0.0, 0, -1, -1, 0.0, 0), given
        return Evidence(0, -1, nowhere, 0.0, 0, -1, -1, 0.0, 0), given
    if plan.teachers > 0 and plan.asks_before == ASK_GUIDANCE:
        guidance, given = merged_guidance(world, plan, teachers, keys, scratch.votes, state, decision)
        said = 1 if guidance != 0 else 0
        return Evidence(said, -1, nowhere, 0.0, guidance, -1, -1, 0.0, 0), given
    return Evidence(0, -1, nowhere, 0.0, 0, -1, -1, 0.0, 0), 0


@kernel
def said_after(  # noqa: PLR0913, PLR0917 - what an answer depends on
    world: LaneWorld,
    plan: LanePlan,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    scratch: Scratch,
    state: int,
    action: int,
    step: int,
    before: Evidence,
    decision: int,
) -> tuple[Evidence, int]:
    """Return what has been said before and after the action, and how many said something after it."""
    if plan.teachers > 0 and plan.asks_after == ASK_REWARD:
        actions = len(scratch.votes)
        praise, given = merged_reward(world, plan, teachers, keys, state, action, actions, decision)
        if praise != 0.0:
            nowhere = scratch.one_hot[actions]
            return Evidence(1, -1, nowhere, praise, before.guidance, -1, -1, 0.0, 0), given
        return before, given
    if plan.teachers > 0 and plan.asks_after == ASK_MISTAKE:
        better, given = merged_mark(world, plan, teachers, keys, scratch.votes, state, action, decision)
        if better >= 0:
            return Evidence(1, better, scratch.one_hot[better], 0.0, 0, step, step, 0.0, 0), given
        return before, given
    return before, 0


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
    return most_votes(votes), given


@kernel
def most_votes(votes: MutableSequence[float]) -> int:
    """Return the action with most votes; -1 for a tie or where there are none."""
    chosen = -1
    most = 0.0
    for action in range(len(votes)):
        if votes[action] > most:
            most = votes[action]
            chosen = action
        elif votes[action] == most:
            chosen = -1
    return chosen


@kernel
def merged_mark(
    world: LaneWorld,
    plan: LanePlan,
    teachers: tuple[LaneTeacher, ...],
    keys: Sequence[int],
    votes: MutableSequence[float],
    state: int,
    action: int,
    decision: int,
) -> tuple[int, int]:
    """Return what most who mark the step would have done, -1 for none or a tie, and how many mark."""
    actions = len(votes)
    given = 0
    for other in range(actions):
        votes[other] = 0.0
    for number in range(plan.teachers):
        teacher = teachers[number]
        better = mark_of(
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
        if better >= 0:
            votes[better] += 1.0
            given += 1
    return most_votes(votes), given


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
