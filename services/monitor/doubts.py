"""Where teachers disagree, and which states are doubtful: their labels are likely to be wrong.

A state is doubtful when what was said there cannot all be right: two teachers named different actions on the
same visit, a teacher named another action than before, or the named move ran into a wall or box, or ended the
episode unsolved. Each counts as often as it happened; states are ranked by that number.
"""

from collections import Counter, OrderedDict
from dataclasses import dataclass, field

from protocol.messages import Step

STATES_MAX = 20_000
"""States remembered; the one labelled longest ago goes first."""
SHOWN_MAX = 6


@dataclass(slots=True)
class Doubtful:
    """What was said in one state."""

    view: str
    visits: int = 0
    """Visits on which somebody named an action."""
    split: int = 0
    """Of these, visits on which two named different ones."""
    turned: int = 0
    """Times that a teacher named another action than on their visit before."""
    blocked: int = 0
    """Times that the named move was made and moved nothing."""
    fatal: int = 0
    """Times that the named move was made and ended the episode unsolved."""
    named: dict[str, Counter[str]] = field(default_factory=dict)
    """How often each teacher named it, by action."""
    last: dict[str, str] = field(default_factory=dict)

    @property
    def score(self) -> int:
        """How often something was said here that cannot all be right."""
        return self.split + self.turned + self.blocked + self.fatal

    def reasons(self) -> str:
        """Return in words what makes the state doubtful."""
        found = (
            (self.split, f"teachers differed on {self.split} of {self.visits} visits"),
            (self.turned, f"a teacher changed their mind {_times(self.turned)}"),
            (self.blocked, f"the named move moved nothing {_times(self.blocked)}"),
            (self.fatal, f"the named move ended it unsolved {_times(self.fatal)}"),
        )
        return "; ".join(text for count, text in found if count)


class Doubts:
    """Every labelled state of a session, bounded."""

    __slots__ = ("_cells", "_states", "_states_max")

    def __init__(self, states_max: int = STATES_MAX) -> None:
        self._states: OrderedDict[bytes, Doubtful] = OrderedDict()
        self._cells: dict[int, tuple[int, int]] = {}
        self._states_max = states_max

    def add(self, step: Step, cell: int) -> bool:
        """Take the labels of a step; tell whether there were any.

        Args: cell: where the player stood.
        """
        labels = {said.teacher: said.action for said in step.said if said.action is not None}
        if not labels:
            return False
        state = self._states.setdefault(step.state, Doubtful(step.view))
        self._states.move_to_end(step.state)
        if len(self._states) > self._states_max:
            self._states.popitem(last=False)
        split = len(set(labels.values())) > 1
        state.visits += 1
        state.split += split
        for teacher, action in labels.items():
            state.turned += state.last.get(teacher, action) != action
            state.last[teacher] = action
            state.named.setdefault(action, Counter())[teacher] += 1
        if step.action == step.label:
            state.blocked += step.view == step.next_view
            state.fatal += step.outcome in {"deadlock", "failed"}
        visits, splits = self._cells.get(cell, (0, 0))
        self._cells[cell] = visits + 1, splits + split
        return True

    def cells(self) -> dict[int, tuple[int, int]]:
        """Return (labelled visits, visits on which teachers differed) by the player's cell."""
        return self._cells

    def worst(self, count: int = SHOWN_MAX) -> list[Doubtful]:
        """Return the most doubtful states, the worst first."""
        doubtful = [state for state in self._states.values() if state.score]
        return sorted(doubtful, key=lambda state: (-state.score, -state.visits, state.view))[:count]


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
