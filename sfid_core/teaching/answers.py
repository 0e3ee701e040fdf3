"""What a teacher can say about a decision."""

from enum import Enum

from sfid_core.record import record


class AnswerKind(Enum):
    """The forms an answer can take; a method asks for one of them, abstention is always allowed."""

    LABEL = "label"
    """The action the teacher would take in the state (Shaping from Interactive Demonstrations)."""
    REWARD = "reward"
    """Praise or blame for the action that was seen, in [-1, 1] (interactive reward shaping)."""
    GUIDANCE = "guidance"
    """A set of actions worth considering, given before the action (Thomaz & Breazeal 2006)."""
    UNDO = "undo"
    """Take the last step back (Thomaz & Breazeal 2006)."""
    MISTAKE = "mistake"
    """A stretch of steps that went wrong, and what should have been done (De la Cruz et al. 2015)."""
    ABSTAIN = "abstain"
    """Seen, and deliberately nothing to say: counts for the quorum, never for learning."""

    __hash__ = object.__hash__  # a member is itself alone; an enum's own hash is the name's, in Python


@record
class Answer:
    """One teacher's answer to one decision.

    `action` is an index into the session's actions (labels, mistake marks), `reward` lies in [-1, 1],
    `guidance` holds action indexes, `steps` the first and last step of a mistake, `posterior` a probability
    for each action.
    """

    kind: AnswerKind
    action: int | None = None
    reward: float | None = None
    guidance: tuple[int, ...] = ()
    steps: tuple[int, int] | None = None
    posterior: tuple[float, ...] = ()
