"""Simulated teachers: an oracle's knowledge with errors and silence, every draw keyed and so repeatable."""

from collections.abc import Sequence

from sfid_core.chance import below, stream, unit
from sfid_core.learning.method import ParameterError


class SimulatedTeacher:
    """A teacher who knows the optimal actions, errs at a rate and is silent at a rate.

    Silence is drawn first, then error. Every draw is named by (seed, name, session) and the decision, so a
    teacher says the same in a live session, in a batch run and after a restart, whatever else was asked in
    between.

    Args: error_rate, silence_rate: probabilities in [0, 1]; actions: number of actions, 1 or more.
    Raises: ParameterError.
    """

    def __init__(
        self,
        seed: int,
        name: str,
        session: str,
        error_rate: float = 0.0,
        silence_rate: float = 0.0,
        actions: int = 4,
    ) -> None:
        _check_rate("error_rate", error_rate)
        _check_rate("silence_rate", silence_rate)
        if actions < 1:
            raise ParameterError(f"actions {actions} is below 1: a world has at least one action")
        self.name = name
        self._error_rate = error_rate
        self._silence_rate = silence_rate
        self._actions = actions
        self._silence, self._error, self._choice, self._preference = (
            stream(seed, "teacher", name, session, draw)
            for draw in ("silence", "error", "choice", "preference")
        )

    def label(self, decision: int, state: bytes, optimal: Sequence[int]) -> int | None:
        """Return the action this teacher names for `state`, or None for silence.

        Of several optimal actions a teacher always names the same one in the same state. An error names one
        of the actions that are not optimal, or, where all are, one that the teacher would not have named;
        with nothing else to name it is silence. Without an optimal action (an unsolvable state) there is
        nothing to say.

        Args: decision: running number in the session, names the draws; optimal: action indexes, in any order.
        """
        if not optimal or self._is_silent(decision):
            return None
        named = self._named(state, sorted(optimal))
        if not self._errs(decision):
            return named
        wrong = [action for action in range(self._actions) if action not in optimal]
        wrong = wrong or [action for action in range(self._actions) if action != named]
        return wrong[below(self._choice, decision, len(wrong))] if wrong else None

    def reward(
        self,
        decision: int,
        state: bytes,  # noqa: ARG002 - every optimal action is praised alike, so the state draws nothing
        action: int,
        optimal: Sequence[int],
    ) -> float | None:
        """Return +1 where `action` is an optimal one and -1 where not, flipped by an error; None is silence.

        Args: state: the state that the agent acted in, which `optimal` belongs to. Without an optimal action
        there is nothing to say.
        """
        if not optimal or self._is_silent(decision):
            return None
        praised = (action in optimal) is not self._errs(decision)
        return 1.0 if praised else -1.0

    def _is_silent(self, decision: int) -> bool:
        return unit(self._silence, decision) < self._silence_rate

    def _errs(self, decision: int) -> bool:
        return unit(self._error, decision) < self._error_rate

    def _named(self, state: bytes, optimal: Sequence[int]) -> int:
        if len(optimal) == 1:
            return optimal[0]
        return optimal[below(stream(self._preference, state.hex()), 0, len(optimal))]


def _check_rate(name: str, rate: float) -> None:
    if not 0 <= rate <= 1:
        raise ParameterError(f"{name} {rate} is outside [0, 1]: 0 is never, 1 is always")
