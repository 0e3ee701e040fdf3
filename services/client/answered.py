"""The last answer of a teacher, and the window it was given to."""

from typing import NamedTuple

from protocol.messages import Answer, Decision


class Answered(NamedTuple):
    """An answer and its window: a decision has two where teachers are asked before and after the action."""

    answer_id: bytes
    epoch: int
    decision: int
    asked: str

    def was_to(self, decision: Decision) -> bool:
        """Tell whether the answer was to this window, whatever the epoch."""
        return (self.decision, self.asked) == (decision.decision, decision.asked)


def answered_with(message: Answer, current: Decision | None) -> Answered:
    """Return the answer with what its window asked; an abstention is to the decision as it stands."""
    asked: str = message.kind
    if asked == "undo":
        asked = "reward"
    elif asked == "abstain" and current is not None:
        asked = current.asked
    return Answered(message.answer_id, message.epoch, message.decision, asked)
