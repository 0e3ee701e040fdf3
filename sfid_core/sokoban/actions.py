"""The four actions of the grid, in the order of the founding paper."""

from enum import IntEnum


class Action(IntEnum):
    """One move of the player: names on the wire, indexes 0..3 in tables."""

    LEFT = 0
    RIGHT = 1
    UP = 2
    DOWN = 3

    @property
    def delta(self) -> tuple[int, int]:
        """Return the change (rows, columns) of the player's cell; rows grow downwards."""
        return DELTAS[self]

    @property
    def letter(self) -> str:
        """Return the lower-case LURD letter of this action."""
        return LETTERS[self]

    @property
    def opposite(self) -> "Action":
        """Return the action that walks back."""
        return Action(self ^ 1)


DELTAS = ((0, -1), (0, 1), (-1, 0), (1, 0))
LETTERS = "lrud"
ACTIONS = tuple(Action)
"""The members by index: ACTIONS[i] is several times faster than Action(i)."""
