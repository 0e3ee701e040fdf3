"""What the simulated teachers of a lane say about one decision, merged as a live session merges it.

One kernel for every kind of question and for one teacher or several; `batch` takes those of the session. All
that are asked before the action take the same arguments, and all that are asked after it.
"""

from collections.abc import MutableSequence, Sequence

from sfid_core.compiled import kernel
from sfid_core.experiments.lane_world import N_ACTIONS, LaneTeacher, LaneWorld, Scratch
from sfid_core.learning.kernels import Evidence
from sfid_core.teaching.kernels import guidance_of, label_of, mark_of, reward_of

Teachers = tuple[LaneTeacher, ...]


@kernel
def nothing_before(
    world: LaneWorld,  # noqa: ARG001
    teachers: Teachers,  # noqa: ARG001
    keys: Sequence[int],  # noqa: ARG001
    scratch: Scratch,
    state: int,  # noqa: ARG001
    decision: int,  # noqa: ARG001
) -> tuple[Evidence, int]:
    """Return silence: nobody is asked in the frozen state. The number is of those who said something."""
    return silence(scratch), 0


@kernel
def label_before(
    world: LaneWorld, teachers: Teachers, keys: Sequence[int], scratch: Scratch, state: int, decision: int
) -> tuple[Evidence, int]:
    """Return the one teacher's label."""
    word, optimal = world.word[state], world.optimal[state]
    one = teachers[0]
    label = label_of(one.parameters, one.memory, keys[0], decision, word, optimal, N_ACTIONS)
    if label >= 0:
        return Evidence(1, label, scratch.one_hot[label], 0.0, 0, -1, -1, 0.0, 0), 1
    return silence(scratch), 0


@kernel
def labels_before(
    world: LaneWorld, teachers: Teachers, keys: Sequence[int], scratch: Scratch, state: int, decision: int
) -> tuple[Evidence, int]:
    """Return the label most teachers name; a tie is silence."""
    word, optimal = world.word[state], world.optimal[state]
    given = cleared(scratch.votes)
    for number in range(len(teachers)):
        one = teachers[number]
        label = label_of(one.parameters, one.memory, keys[number], decision, word, optimal, N_ACTIONS)
        given += vote(scratch.votes, label)
    label = most_votes(scratch.votes)
    if label >= 0:
        return Evidence(1, label, scratch.one_hot[label], 0.0, 0, -1, -1, 0.0, 0), given
    return silence(scratch), given


@kernel
def guidance_before(
    world: LaneWorld, teachers: Teachers, keys: Sequence[int], scratch: Scratch, state: int, decision: int
) -> tuple[Evidence, int]:
    """Return the actions that more than half of the guiding teachers point at."""
    word, optimal = world.word[state], world.optimal[state]
    given = cleared(scratch.votes)
    for number in range(len(teachers)):
        one = teachers[number]
        guidance = guidance_of(one.parameters, one.memory, keys[number], decision, word, optimal, N_ACTIONS)
        given += guidance != 0
        for action in range(N_ACTIONS):
            scratch.votes[action] += (guidance >> action) & 1
    merged = 0
    for action in range(N_ACTIONS):
        if 2.0 * scratch.votes[action] > given:
            merged |= 1 << action
    said = 1 if merged != 0 else 0
    return Evidence(said, -1, scratch.one_hot[N_ACTIONS], 0.0, merged, -1, -1, 0.0, 0), given


@kernel
def nothing_after(  # noqa: PLR0913, PLR0917 - what an answer depends on
    world: LaneWorld,  # noqa: ARG001
    teachers: Teachers,  # noqa: ARG001
    keys: Sequence[int],  # noqa: ARG001
    scratch: Scratch,  # noqa: ARG001
    state: int,  # noqa: ARG001
    action: int,  # noqa: ARG001
    step: int,  # noqa: ARG001
    before: Evidence,
    decision: int,  # noqa: ARG001
) -> tuple[Evidence, int]:
    """Return what was said before the action: nobody is asked after it."""
    return before, 0


@kernel
def reward_after(  # noqa: PLR0913, PLR0917 - as nothing_after
    world: LaneWorld,
    teachers: Teachers,
    keys: Sequence[int],
    scratch: Scratch,
    state: int,
    action: int,
    step: int,  # noqa: ARG001
    before: Evidence,
    decision: int,
) -> tuple[Evidence, int]:
    """Return the one teacher's reward."""
    word, optimal = world.word[state], world.optimal[state]
    one = teachers[0]
    given = reward_of(one.parameters, one.memory, keys[0], decision, state, word, optimal, action, N_ACTIONS)
    if given != 0.0:
        return Evidence(1, -1, scratch.one_hot[N_ACTIONS], given, before.guidance, -1, -1, 0.0, 0), 1
    return before, 0


@kernel
def rewards_after(  # noqa: PLR0913, PLR0917 - as nothing_after
    world: LaneWorld,
    teachers: Teachers,
    keys: Sequence[int],
    scratch: Scratch,
    state: int,
    action: int,
    step: int,  # noqa: ARG001
    before: Evidence,
    decision: int,
) -> tuple[Evidence, int]:
    """Return the mean reward of the side with more votes; a tie is silence."""
    word, optimal = world.word[state], world.optimal[state]
    praise = blame = 0.0
    for_it = against = 0
    for number in range(len(teachers)):
        one = teachers[number]
        given = reward_of(
            one.parameters, one.memory, keys[number], decision, state, word, optimal, action, N_ACTIONS
        )
        if given > 0.0:
            praise += given
            for_it += 1
        elif given < 0.0:
            blame += given
            against += 1
    if for_it == against:
        return before, for_it + against
    mean = praise / for_it if for_it > against else blame / against
    nowhere = scratch.one_hot[N_ACTIONS]
    return Evidence(1, -1, nowhere, mean, before.guidance, -1, -1, 0.0, 0), for_it + against


@kernel
def mark_after(  # noqa: PLR0913, PLR0917 - as nothing_after
    world: LaneWorld,
    teachers: Teachers,
    keys: Sequence[int],
    scratch: Scratch,
    state: int,
    action: int,
    step: int,
    before: Evidence,
    decision: int,
) -> tuple[Evidence, int]:
    """Return the step as a mistake with what most who mark it would have done; a tie is silence."""
    word, optimal = world.word[state], world.optimal[state]
    given = cleared(scratch.votes)
    for number in range(len(teachers)):
        one = teachers[number]
        better = mark_of(
            one.parameters, one.memory, keys[number], decision, state, word, optimal, action, N_ACTIONS
        )
        given += vote(scratch.votes, better)
    better = most_votes(scratch.votes)
    if better >= 0:
        return Evidence(1, better, scratch.one_hot[better], 0.0, 0, step, step, 0.0, 0), given
    return before, given


@kernel
def silence(scratch: Scratch) -> Evidence:
    """Return the evidence of an answer that nobody gave."""
    return Evidence(0, -1, scratch.one_hot[N_ACTIONS], 0.0, 0, -1, -1, 0.0, 0)


@kernel
def cleared(votes: MutableSequence[float]) -> int:
    """Set all votes to none; return how many there are."""
    for action in range(N_ACTIONS):
        votes[action] = 0.0
    return 0


@kernel
def vote(votes: MutableSequence[float], action: int) -> int:
    """Count a vote for an action; return 1, or 0 for -1, which is none."""
    if action < 0:
        return 0
    votes[action] += 1.0
    return 1


@kernel
def most_votes(votes: MutableSequence[float]) -> int:
    """Return the action with most votes; -1 for a tie or where there are none."""
    chosen = -1
    most = 0.0
    for action in range(N_ACTIONS):
        if votes[action] > most:
            most = votes[action]
            chosen = action
        elif votes[action] == most:
            chosen = -1
    return chosen
