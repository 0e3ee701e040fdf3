"""Small models of what must hold, written anew for the checkers: they share no code with the machines."""

from collections.abc import Iterable, Sequence
from hashlib import sha256
from struct import pack

ACTIONS = ("LEFT", "RIGHT", "UP", "DOWN")
_MOVES = {"LEFT": (0, -1), "RIGHT": (0, 1), "UP": (-1, 0), "DOWN": (1, 0)}
_ON_GOAL = {"@": "+", "$": "*", " ": "."}
_OFF_GOAL = {on: off for off, on in _ON_GOAL.items()}


def moved(view: str, action: str) -> str:
    """Return the Sokoban view (XSB) after one action: a walk, a push, or nothing where the way is blocked."""
    rows = [list(row) for row in view.split("\n")]
    y, x = next((y, x) for y, row in enumerate(rows) for x, char in enumerate(row) if char in "@+")
    dy, dx = _MOVES[action]
    near, far = (y + dy, x + dx), (y + 2 * dy, x + 2 * dx)
    if _at(rows, near) in "$*":
        if _at(rows, far) not in " .":
            return view
        _leave(rows, near)
        _enter(rows, far, "$")
    elif _at(rows, near) not in " .":
        return view
    _leave(rows, (y, x))
    _enter(rows, near, "@")
    return "\n".join("".join(row) for row in rows)


def _at(rows: list[list[str]], place: tuple[int, int]) -> str:
    y, x = place
    return rows[y][x] if 0 <= y < len(rows) and 0 <= x < len(rows[y]) else "#"


def _leave(rows: list[list[str]], place: tuple[int, int]) -> None:
    y, x = place
    rows[y][x] = "." if rows[y][x] in "+*" else " "


def _enter(rows: list[list[str]], place: tuple[int, int], who: str) -> None:
    y, x = place
    rows[y][x] = _ON_GOAL[who] if rows[y][x] == "." else who


def opinion(labels: Iterable[str]) -> str | None:
    """Return the action that more teachers named than any other, None for a tie or silence."""
    named = list(labels)
    counts = sorted(((named.count(action), action) for action in set(named)), reverse=True)
    if not counts or (len(counts) > 1 and counts[0][0] == counts[1][0]):
        return None
    return counts[0][1]


def verdict(rewards: Sequence[float]) -> float:
    """Return the mean of the side, praise or blame, that has more votes; 0 where they are equal."""
    praise, blame = [r for r in rewards if r > 0], [r for r in rewards if r < 0]
    if len(praise) == len(blame):
        return 0.0
    side = praise if len(praise) > len(blame) else blame
    return sum(side) / len(side)


class Table:
    """Q by state, learnt by Watkins' rule with h added to the reward (paper Eq. 4)."""

    def __init__(self, alpha: float, gamma: float) -> None:
        self._alpha, self._gamma = alpha, gamma
        self._rows: dict[bytes, list[float]] = {}

    def learn(self, state: bytes, action: str, reward: float, h: float, after: bytes | None) -> None:
        """Learn from one step; `after` is None where nothing can follow."""
        best = 0.0 if after is None else max(self._rows.get(after, [0.0]))
        row = self._rows.setdefault(state, [0.0] * len(ACTIONS))
        at = ACTIONS.index(action)
        row[at] += self._alpha * ((reward + self._gamma * best - row[at]) + h)

    def sha256(self) -> str:
        """Return the digest over all rows in the order of their states."""
        rows = sorted(self._rows.items())
        return sha256(b"".join(state + pack("<4d", *row) for state, row in rows)).hexdigest()
