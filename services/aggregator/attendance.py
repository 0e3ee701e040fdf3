"""Who is in a crowd: noticed by a token that comes, goes, or does not come back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.keys import KeyNameError
from sfid_core.crowd.round import MemberJoined, MemberLeft

if TYPE_CHECKING:
    from services.aggregator.live import LiveCrowd
    from services.aggregator.service import Aggregator
    from services.runtime.bus import Presence

Places = frozenset[tuple[str, str]]
"""(session, worker)."""


class Attendance:
    """Watches the tokens of members on the loop's thread."""

    def __init__(self, aggregator: Aggregator) -> None:
        self._aggregator = aggregator
        self._present: set[tuple[str, str]] = set()

    def on_presence(self, presence: Presence) -> None:
        """Count in who comes back, and out who is gone."""
        aggregator = self._aggregator
        try:
            session, worker = aggregator.keys.session_and_teacher(presence.key)
        except KeyNameError:  # anybody may announce anything
            return
        live = aggregator.crowds.get(session)
        if presence.present:
            self._present.add((session, worker))
            # Anybody may announce anything: where tokens are required, whoever comes back joins with theirs.
            if live is not None and not aggregator.config.require_tokens and _comes_back(live, worker):
                aggregator.happen(live, MemberJoined(worker))
            return
        self._present.discard((session, worker))
        aggregator.reception.desk.has_left(session, worker)
        if live is not None and _is_member(live, worker):
            aggregator.happen(live, MemberLeft(worker))

    def expect(self, live: LiveCrowd, worker: str) -> None:
        """Let a member who joined go again unless their token is there soon: else nobody sees them die."""
        self._expect(frozenset({(live.name, worker)}))

    def expect_all(self) -> None:
        """Let those go who were members before a restart and do not come back; leave what is empty then."""
        crowds = self._aggregator.crowds.values()
        self._expect(
            frozenset(
                (live.name, worker)
                for live in crowds
                if live.crowd is not None
                for worker in live.crowd.members
            )
        )
        aggregator = self._aggregator
        for live in tuple(crowds):
            aggregator.loop.call_later(aggregator.config.members_gone_ms, aggregator.stay_or_leave, live)

    def let_go(self, session: str, worker: str) -> None:
        """Wait no longer for a member whose token is no longer good."""
        live = self._aggregator.crowds.get(session)
        if live is not None and _is_member(live, worker):
            self._aggregator.happen(live, MemberLeft(worker))

    def _expect(self, places: Places) -> None:
        aggregator = self._aggregator
        aggregator.loop.call_later(aggregator.config.members_gone_ms, self._mark_gone, places)

    def _mark_gone(self, expected: Places) -> None:
        for name, worker in sorted(expected - self._aggregator.reception.desk.proved(self._present)):
            live = self._aggregator.crowds.get(name)
            if live is not None and _is_member(live, worker):
                self._aggregator.happen(live, MemberLeft(worker))


def _is_member(live: LiveCrowd, worker: str) -> bool:
    return live.crowd is not None and worker in live.crowd.members


def _comes_back(live: LiveCrowd, worker: str) -> bool:
    missing = live.crowd is not None and worker not in live.crowd.members
    return missing and worker in live.known and not live.finished
