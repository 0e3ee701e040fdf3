"""A teacher of one's own: it looks at each board, says which way it would go, and tells how that went.

python -m services.client.example tcp/127.0.0.1:7447 lesson
"""

import sys

from services.client import join
from sfid_core.sokoban.levels import parse_levels
from sfid_core.sokoban.solver import solve


def teach(endpoint: str, session: str, teacher: str = "example") -> int:
    """Teach a session to its end; returns how many labels were given."""
    labels, solution = 0, None
    with join(endpoint, session, teacher) as teaching:
        for decision in teaching.decisions():
            board = parse_levels(decision.view)[0].start
            solution = solution or solve(board.level)
            best = solution.optimal_actions(board)
            teaching.answer(decision, action=best[0].name if best else None)  # None: nothing to say
            labels += bool(best)
    return labels


if __name__ == "__main__":
    sys.stdout.write(f"{teach(*sys.argv[1:])} labels given\n")
