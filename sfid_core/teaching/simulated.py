"""Simulated teachers: an oracle's knowledge with errors and silence, every draw keyed and so repeatable."""

from collections.abc import Iterable, Sequence

from sfid_core.chance import stream
from sfid_core.learning.parameters import ParameterError
from sfid_core.teaching.kernels import (
    TEACHER_SCALARS,
    TeacherMemory,
    TeacherParameters,
    delay_of,
    guidance_of,
    label_of,
    mark_of,
    preference_key,
    preferred_of,
    reward_of,
)


def teacher_key(seed: int, name: str, session: str) -> int:
    """Return the key of all that a simulated teacher draws in a session."""
    return stream(seed, "teacher", name, session)


def state_word(state: bytes) -> int:
    """Return the 64 bits of a state's key that name a teacher's preference in it."""
    return int.from_bytes(state[:8], "little") ^ int.from_bytes(state[8:16], "little")


class SimulatedTeacher:
    """A teacher who knows the optimal actions and has the faults of `parameters`.

    Every draw is named by (seed, name, session) and the decision, so a teacher says the same in a live
    session, in a batch run and after a restart, whatever else was asked in between.

    Args: actions: number of actions, 1 or more. Raises: ParameterError.
    """

    def __init__(
        self, seed: int, name: str, session: str, parameters: TeacherParameters, actions: int = 4
    ) -> None:
        if actions < 1:
            raise ParameterError(f"actions {actions} is below 1: a world has at least one action")
        self.name = name
        self.parameters = parameters
        self.key = teacher_key(seed, name, session)
        self._actions = actions
        self._memory = TeacherMemory([0.0] * TEACHER_SCALARS, [])
        self._numbers: dict[bytes, int] = {}

    def label(self, decision: int, state: bytes, optimal: Iterable[int]) -> int | None:
        """Return the action this teacher names for `state`, or None for silence.

        Of several optimal actions a teacher always names the same one in the same state.

        Args: decision: running number in the session, names the draws; optimal: action indexes, in any order.
        """
        word, bits = state_word(state), action_bits(optimal)
        said = label_of(self.parameters, self._memory, self.key, decision, word, bits, self._actions)
        return None if said < 0 else said

    def mark(self, decision: int, state: bytes, action: int, optimal: Iterable[int]) -> int | None:
        """Return what should have been done instead of `action`, or None where nothing is marked.

        Args: state: the state that the agent acted in, which `optimal` belongs to.
        """
        bits, word, number = action_bits(optimal), state_word(state), self._number(state)
        named = mark_of(
            self.parameters, self._memory, self.key, decision, number, word, bits, action, self._actions
        )
        return None if named < 0 else named

    def guidance(self, decision: int, state: bytes, optimal: Iterable[int]) -> tuple[int, ...]:
        """Return the actions this teacher points at, ascending; none is silence."""
        bits = guidance_of(
            self.parameters,
            self._memory,
            self.key,
            decision,
            state_word(state),
            action_bits(optimal),
            self._actions,
        )
        return tuple(action for action in range(self._actions) if bits >> action & 1)

    def reward(self, decision: int, state: bytes, action: int, optimal: Iterable[int]) -> float | None:
        """Return what this teacher thinks of `action`, in [-1, 1], or None for silence.

        Args: state: the state that the agent acted in, which `optimal` belongs to.
        """
        bits, word, number = action_bits(optimal), state_word(state), self._number(state)
        given = reward_of(
            self.parameters, self._memory, self.key, decision, number, word, bits, action, self._actions
        )
        return given or None

    def delay_ms(self, decision: int) -> float:
        """Return how long this teacher takes to answer, in ms."""
        return delay_of(self.parameters, self.key, decision)

    def preferred(self, state: bytes, optimal: Sequence[int]) -> int | None:
        """Return the action this teacher would name without fault, or None without an optimal one."""
        bits, word = action_bits(optimal), state_word(state)
        named = preferred_of(preference_key(self.parameters, self.key, 0), word, bits, self._actions)
        return None if named < 0 else named

    def _number(self, state: bytes) -> int:
        """Return the state's place in what is remembered of praise."""
        number = self._numbers.get(state)
        if number is None:
            number = self._numbers[state] = len(self._numbers)
            self._memory.praised.extend([0.0] * self._actions)
        return number


def action_bits(actions: Iterable[int]) -> int:
    """Return a number whose bit a is set for every action a."""
    bits = 0
    for action in actions:
        bits |= 1 << action
    return bits
