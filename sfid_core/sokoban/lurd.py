"""Solutions as letters: l, u, r, d for a walk, capitals for a push (sokobano.de wiki, "Level format")."""

from collections.abc import Iterable

from sfid_core.sokoban.actions import ACTIONS, LETTERS, Action
from sfid_core.sokoban.board import Board
from sfid_core.sokoban.rules import step


def to_lurd(board: Board, actions: Iterable[Action]) -> str:
    """Return the actions from a board on as letters; blocked ones, which the notation lacks, are left out."""
    letters = []
    for action in actions:
        board, moved, pushed = step(board, action)
        if moved:
            letters.append(action.letter.upper() if pushed else action.letter)
    return "".join(letters)


def from_lurd(text: str) -> tuple[Action, ...]:
    """Read letters of either case, white space between them ignored; ValueError names any other."""
    actions = []
    for position, letter in enumerate(text, start=1):
        if letter.isspace():
            continue
        index = LETTERS.find(letter.lower())
        if index < 0:
            message = f"character {position} of the solution is {letter!r}; use l, u, r, d or their capitals"
            raise ValueError(message)
        actions.append(ACTIONS[index])
    return tuple(actions)
