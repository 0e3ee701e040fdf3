"""Sessions rebuilt from their journal, the long ones while the journal is still being proven."""

from __future__ import annotations

from collections.abc import Iterator

from protocol.codec import DecodeError
from protocol.journal import Folded, Folding
from services.runtime.journal.beside import UnprovenRows
from services.runtime.journal.errors import JournalError
from services.runtime.journal.shard import Shard
from sfid_core.learning.parameters import ParameterError


class Recovery:
    """Rebuilds the sessions of one shard: `begin` is the `meanwhile` of `Shard.open`, `sessions` follows."""

    def __init__(self) -> None:
        self._begun: dict[str, Folding] = {}

    def begin(self, rows: UnprovenRows) -> None:
        """Rebuild what can be read; nobody sees it before `sessions`, which is told whether it holds."""
        for name in rows.sessions():
            folding = self._begun[name] = Folding()
            folding.take(rows.events(name))

    def sessions(self, shard: Shard) -> Iterator[tuple[str, Folded]]:
        """Yield each session that was created, in the order of creation, as the opened shard holds it.

        Raises: JournalError when a session cannot be read.
        """
        begun, self._begun = self._begun, {}
        for name in shard.sessions():
            folding = begun.get(name) if shard.read_ahead else None
            try:
                if folding is None:
                    folding = Folding()
                    folding.take(shard.events(name))
                else:
                    folding.take(shard.events(name, shard.read_ahead))
            except (DecodeError, ParameterError) as error:
                message = f"session {name}: its journal cannot be read by this version ({error})"
                raise JournalError(message) from None
            if folding.folded is not None:
                yield name, folding.folded
