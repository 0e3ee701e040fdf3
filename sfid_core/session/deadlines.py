"""The deadlines of the latest decisions, packed: they tell superseded answers from late ones."""

from array import array

DEADLINES_KEPT = 16
"""Decisions whose deadline is remembered. A person lags one decision behind, a stopped network a few; older
is late."""
_ENDLESS = -(2**63)
_OVER = 0
"""The deadline of decisions that are not remembered: long over."""


class Deadlines:
    """Deadlines of the latest decisions, at most DEADLINES_KEPT; 300 bytes, where a dict takes 2,000."""

    __slots__ = ("_pairs",)

    def __init__(self) -> None:
        self._pairs = array("q")

    def note(self, decision: int, deadline_ns: int | None) -> None:
        """Remember a decision's deadline in the place of an earlier one; None: it has no deadline."""
        pairs = self._pairs
        if pairs and pairs[-2] == decision:
            del pairs[-2:]
        elif len(pairs) == 2 * DEADLINES_KEPT:
            del pairs[:2]
        pairs.append(decision)
        pairs.append(_ENDLESS if deadline_ns is None else deadline_ns)

    def of(self, decision: int) -> int | None:
        """Return a decision's deadline, None when it has none, 0 when it is not remembered."""
        pairs = self._pairs
        for at in range(len(pairs) - 2, -2, -2):
            if pairs[at] == decision:
                return None if pairs[at + 1] == _ENDLESS else pairs[at + 1]
        return _OVER

    def clear(self) -> None:
        """Remember nothing."""
        del self._pairs[:]

    def __eq__(self, other: object) -> bool:
        """Tell whether the same is remembered."""
        return isinstance(other, Deadlines) and self._pairs == other._pairs

    __hash__ = None  # type: ignore[assignment]  # it changes

    def __len__(self) -> int:
        """Return of how many decisions the deadline is remembered."""
        return len(self._pairs) // 2
