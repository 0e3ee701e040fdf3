"""How a step leaves its episode."""

from enum import Enum


class Outcome(Enum):
    """Going on, or ended and why."""

    RUNNING = "running"
    SOLVED = "solved"
    DEADLOCK = "deadlock"
    """A level that can no longer be solved."""
    CAP = "cap"
    """Cut off after the largest number of steps that an episode may have."""
    FAILED = "failed"
    """Ended by the world itself, and not well: a cliff, a hole in the ice."""

    def __init__(self, word: str) -> None:
        self.word = word
        """The value, as a plain attribute: read at every step, where `value` costs a call."""
        self.terminal = word in {"solved", "deadlock", "failed"}
        """Whether nothing can follow. A capped episode is not terminal: the learner looks ahead from it."""
