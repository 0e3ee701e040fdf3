"""How the answers of several direct teachers become one: a vote each, and a tie is silence (our rule)."""

from collections.abc import Iterable

from sfid_core.teaching.answers import Answer, AnswerKind


def merge_labels(answers: Iterable[Answer]) -> int | None:
    """Return the action that most teachers named, or None when nobody named one or there is a tie."""
    votes: dict[int | None, int] = {}
    for answer in answers:
        if answer.kind is AnswerKind.LABEL:
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
