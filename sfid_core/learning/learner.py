"""A learner of one session: a method's kernels over rows that come into being as states are met."""

import struct
from collections.abc import Sequence
from hashlib import sha256

from sfid_core.chance import draw, stream
from sfid_core.learning.kernels import (
    Draws,
    Evidence,
    Learned,
    Memory,
    Transition,
    keep_action,
    keep_step,
    prefer,
)
from sfid_core.learning.method import Method, Numbers


def learner_draws(seed: int, session: str) -> Draws:
    """Return the streams of a session's learner."""
    key = stream(seed, "learner", session)
    return Draws(draw(key, 0), draw(key, 1))


class _Rows(dict[bytes, int]):
    """The number of each state's row; a state met for the first time gets the next one, and a blank row."""

    __slots__ = ("_blank", "_values")

    def __init__(self, values: list[float], width: int) -> None:
        super().__init__()
        self._values = values
        self._blank = (0.0,) * width

    def __missing__(self, state: bytes) -> int:
        number = self[state] = len(self)
        self._values.extend(self._blank)
        return number


class Learner:
    """A method at work on states named by key.

    Args: actions: number of actions, 1 or more; trail_steps: steps of an episode that a trail holds at most;
    it grows with the episodes, few of which come near their cap.
    Rows that were only looked at count for nothing: digest and length tell of states learnt about.
    Attributes: settles: whether the action may become another once teachers have answered.
    """

    def __init__(
        self, method: Method, parameters: Numbers, actions: int, draws: Draws, trail_steps: int
    ) -> None:
        self.method = method
        self.parameters = parameters
        self._draws = draws
        self._width = method.width(actions)
        values: list[float] = []
        self._rows = _Rows(values, self._width)
        self._trail: list[float] = []
        self._trail_max = trail_steps * method.trail
        self.memory = Memory(values, [0.0] * method.scalars, self._trail, actions, self._width)
        self._values = values
        # What a method leaves as it is need not be called at every step.
        self.settles = method.settle is not keep_action
        self._undoes = method.undo is not keep_step
        self._prefers = method.prefer is not prefer

    def begin(self, episode: int) -> None:
        """Begin an episode (0 or more)."""
        self.method.begin(self.memory, self.parameters, episode)

    def choose(self, state: bytes, decision: int) -> int:
        """Return the action for `state`; `decision` names every draw."""
        return self.method.choose(self.memory, self.parameters, self._draws, self._rows[state], decision)

    def settle(self, state: bytes, action: int, evidence: Evidence, decision: int) -> int:
        """Return the action that is taken once teachers have answered."""
        row = self._rows[state]
        return self.method.settle(self.memory, self.parameters, self._draws, row, action, evidence, decision)

    def undoes(self, evidence: Evidence) -> bool:
        """Tell whether the environment shall take back the step that teachers said this about."""
        return self._undoes and self.method.undo(self.parameters, evidence) == 1

    def learn(  # noqa: PLR0913 - a step has these parts
        self,
        state: bytes,
        action: int,
        reward: float,
        evidence: Evidence,
        next_state: bytes,
        *,
        terminal: bool,
        step: int,
        distances: tuple[int, int] = (-1, -1),
        span_ms: float = 0.0,
    ) -> Learned:
        """Update from one transition; `distances` are the fewest steps to solved before and after it."""
        here, there = self._rows[state], self._rows[next_state]
        if self._trail_max and len(self._trail) < (step + 1) * self.method.trail:
            self._lengthen_trail(step)
        before, after = distances
        transition = Transition(here, action, reward, there, terminal, step, before, after, span_ms)
        return self.method.learn(self.memory, self.parameters, transition, evidence)

    def values(self, state: bytes) -> tuple[float, ...]:
        """Return how much the policy prefers each action in `state`."""
        row, actions = self._rows[state], self.memory.actions
        if not self._prefers:
            at = row * self._width
            return tuple(self._values[at : at + actions])
        return tuple(
            [self.method.prefer(self.memory, self.parameters, row, action) for action in range(actions)]
        )

    def __len__(self) -> int:
        """Return the number of states learnt about."""
        return sum(self._values[at - 1] > 0 for at in range(self._width, len(self._values) + 1, self._width))

    def sha256(self) -> str:
        """Return the hex SHA-256 of what was learnt; see `table_sha256`."""
        return table_sha256(self._rows, self._values, self._width)

    def _lengthen_trail(self, step: int) -> None:
        wanted = max((step + 1) * self.method.trail, 2 * len(self._trail))
        self._trail.extend([0.0] * (min(wanted, self._trail_max) - len(self._trail)))


def table_sha256(numbers: dict[bytes, int], values: Sequence[float], width: int) -> str:
    """Return the hex SHA-256 over all states learnt about, by ascending key.

    Of each: its key, then its numbers but the count of updates, float64 little-endian.
    """
    pack = struct.Struct(f"<{width - 1}d").pack
    digest = sha256()
    for state in sorted(numbers):
        at = numbers[state] * width
        if values[at + width - 1] > 0:
            digest.update(state)
            digest.update(pack(*values[at : at + width - 1]))
    return digest.hexdigest()
