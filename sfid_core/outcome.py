"""How a step leaves its episode."""

from enum import Enum


class Outcome(Enum):
    """Going on, or ended and why."""

    RUNNING = "running"
    SOLVED = "solved"
    DEADLOCK = "deadlock"
    CAP = "cap"
    """Cut off after the largest number of steps that an episode may have."""

    @property
    def terminal(self) -> bool:
        """Whether nothing can follow. A capped episode is not terminal: the learner looks ahead from it."""
        return self is Outcome.SOLVED or self is Outcome.DEADLOCK  # at every step: a set would hash it
