"""The action-value table: sparse rows by state key."""

import struct
from collections.abc import Iterator, Sequence
from hashlib import sha256


class QTable:
    """Action values Q(s, a), zero until learnt, one row of float64 for each state that was learnt about.

    Args: actions: number of actions, 1 or more.
    A row comes into being at its first update, never by being looked at, so that the digest depends on
    learning alone.
    """

    __slots__ = ("_rows", "_zero", "actions")

    def __init__(self, actions: int) -> None:
        self.actions = actions
        self._rows: dict[bytes, list[float]] = {}
        self._zero: Sequence[float] = (0.0,) * actions

    def values(self, state: bytes) -> Sequence[float]:
        """Return the row of `state` (zeros when nothing was learnt there); not to be written to."""
        return self._rows.get(state, self._zero)

    def row(self, state: bytes) -> list[float]:
        """Return the row of `state` for writing; it exists from now on."""
        row = self._rows.get(state)
        if row is None:
            row = self._rows[state] = [0.0] * self.actions
        return row

    def items(self) -> Iterator[tuple[bytes, list[float]]]:
        """Yield (state, row) in the order of first update."""
        return iter(self._rows.items())

    def __len__(self) -> int:
        """Return the number of states learnt about."""
        return len(self._rows)

    def sha256(self) -> str:
        """Return the hex SHA-256 over all rows by ascending state key: key, then float64 little-endian."""
        pack = struct.Struct(f"<{self.actions}d").pack
        digest = sha256()
        for state in sorted(self._rows):
            digest.update(state)
            digest.update(pack(*self._rows[state]))
        return digest.hexdigest()
