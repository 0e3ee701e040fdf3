"""How the answers of several direct teachers become one: a vote each, and a tie is silence (our rule)."""

from collections import Counter
from collections.abc import Iterable, Sequence

from sfid_core.learning.kernels import Evidence
from sfid_core.teaching.answers import Answer, AnswerKind

SILENCE = Evidence()
LABEL = AnswerKind.LABEL  # met at every step; see `sfid_core.session.machine`


def merge(answers: Sequence[Answer], actions: int, delay_ms: float) -> Evidence:
    """Return what the answers to one window come to.

    Args: answers: at most one a teacher; actions: number of actions; delay_ms: from the showing to the first
    answer.
    """
    if len(answers) == 1:
        return _alone(answers[0], actions, delay_ms)
    undone = sum(answer.kind is AnswerKind.UNDO for answer in answers)
    if 2 * undone > len(answers):
        return _undone(actions, delay_ms)
    label, belief = _merged_labels(answers, actions)
    if label is not None:
        return Evidence(given=1, label=label, belief=belief, delay_ms=delay_ms)
    reward = merge_rewards(answers)
    if reward is not None:
        return Evidence(given=1, belief=_nowhere(actions), reward=reward, delay_ms=delay_ms)
    mark = merge_marks(answers)
    if mark is not None:
        return _alone(mark, actions, delay_ms)
    guidance = merge_guidance(answers)
    if guidance:
        return Evidence(given=1, belief=_nowhere(actions), guidance=guidance, delay_ms=delay_ms)
    return SILENCE


def _alone(answer: Answer, actions: int, delay_ms: float) -> Evidence:
    """Return what one answer says: one teacher alone is taken at their word."""
    if answer.kind is LABEL and answer.action is not None:
        certain: Sequence[float] = ONE_HOT[actions][answer.action]
        belief = answer.posterior or certain
        return Evidence(1, answer.action, belief, 0.0, 0, -1, -1, delay_ms)  # by place: the commonest answer
    if answer.kind is AnswerKind.REWARD and answer.reward:
        return Evidence(given=1, belief=_nowhere(actions), reward=answer.reward, delay_ms=delay_ms)
    if answer.kind is AnswerKind.UNDO:
        return _undone(actions, delay_ms)
    if answer.kind is AnswerKind.GUIDANCE and answer.guidance:
        guidance = sum(1 << action for action in set(answer.guidance))
        return Evidence(given=1, belief=_nowhere(actions), guidance=guidance, delay_ms=delay_ms)
    if answer.kind is AnswerKind.MISTAKE and answer.steps is not None:
        label = -1 if answer.action is None else answer.action
        belief = _nowhere(actions) if label < 0 else ONE_HOT[actions][label]
        first, last = answer.steps
        return Evidence(given=1, label=label, belief=belief, first=first, last=last, delay_ms=delay_ms)
    return SILENCE


def _undone(actions: int, delay_ms: float) -> Evidence:
    """Return what taking a step back says of it: blame."""
    return Evidence(given=1, belief=_nowhere(actions), reward=-1.0, delay_ms=delay_ms, undo=1)


def merge_labels(answers: Iterable[Answer]) -> int | None:
    """Return the action that most teachers named, or None when nobody named one or there is a tie."""
    votes: dict[int | None, int] = {}
    for answer in answers:
        if answer.kind is LABEL:
            votes[answer.action] = votes.get(answer.action, 0) + 1
    most = max(votes.values(), default=0)
    first = [action for action, count in votes.items() if count == most]
    return first[0] if len(first) == 1 else None


def merge_rewards(answers: Iterable[Answer]) -> float | None:
    """Return the mean reward of the side (praise or blame) with more votes, or None when the sides are equal.

    A reward of exactly 0 is a vote for neither side. One teacher alone is therefore taken at their word.
    """
    given = [answer.reward for answer in answers if answer.kind is AnswerKind.REWARD]
    rewards = [reward for reward in given if reward is not None]
    praise = [reward for reward in rewards if reward > 0]
    blame = [reward for reward in rewards if reward < 0]
    if len(praise) == len(blame):
        return None
    side = praise if len(praise) > len(blame) else blame
    return sum(side) / len(side)


def merge_marks(answers: Iterable[Answer]) -> Answer | None:
    """Return the mark (stretch and correction) that most teachers made, or None for none or a tie."""
    votes = Counter(answer for answer in answers if answer.kind is AnswerKind.MISTAKE)
    ranked = votes.most_common(2)
    if not ranked or (len(ranked) > 1 and ranked[0][1] == ranked[1][1]):
        return None
    return ranked[0][0]


def merge_guidance(answers: Iterable[Answer]) -> int:
    """Return the actions that more than half of the guiding teachers named, as bits; 0 for none."""
    sets = [set(answer.guidance) for answer in answers if answer.kind is AnswerKind.GUIDANCE]
    named = {action for one in sets for action in one}
    return sum(1 << action for action in named if 2 * sum(action in one for one in sets) > len(sets))


def _merged_labels(answers: Sequence[Answer], actions: int) -> tuple[int | None, Sequence[float]]:
    """Return the label and the belief in each action: certain, unless an answer carries a posterior.

    With a posterior among them the teachers' beliefs are averaged, and the label is the only largest one.
    """
    labels = [answer for answer in answers if answer.kind is LABEL and answer.action is not None]
    if not any(answer.posterior for answer in labels):
        label = merge_labels(labels)
        return label, _nowhere(actions) if label is None else ONE_HOT[actions][label]
    beliefs = [answer.posterior or ONE_HOT[actions][answer.action or 0] for answer in labels]
    belief = tuple(sum(column) / len(beliefs) for column in zip(*beliefs, strict=True))
    largest = max(belief)
    return (belief.index(largest) if belief.count(largest) == 1 else None), belief


def _nowhere(actions: int) -> Sequence[float]:
    return NOWHERE[actions]


ACTIONS_MAX = 64
"""Largest number of actions of a session, as on the wire."""
ONE_HOT = [
    [tuple(float(place == action) for place in range(actions)) for action in range(actions)]
    for actions in range(ACTIONS_MAX + 1)
]
"""By number of actions and action: certainty in one action."""
NOWHERE = [(0.0,) * actions for actions in range(ACTIONS_MAX + 1)]
"""By number of actions: no belief in any."""
