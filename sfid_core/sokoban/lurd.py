"""Solutions as letters: l, u, r, d for a walk, capitals for a push (sokobano.de wiki, "Level format")."""

from collections.abc import Iterable

from sfid_core.sokoban.actions import Action
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
