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

    def on_presence(self, presence: Presence) -> None:
        """Count in who comes back, and out who is gone."""
        aggregator = self._aggregator
        try:
            session, worker, run = aggregator.keys.presence(presence.key)
        except KeyNameError:  # anybody may announce anything
            return
        live, roll, place = aggregator.crowds.get(session), aggregator.reception.desk.roll, (session, worker)
        if presence.present:
            counts = roll.show(place, run)
            if live is None or not counts:
                return
            # Anybody may announce anything: where tokens are required, whoever comes back joins with theirs.
            if not aggregator.config.require_tokens and _comes_back(live, worker):
                aggregator.happen(live, MemberJoined(worker))
            if run and _is_member(live, worker):
                roll.let_in(place, run)
            return
        if roll.take_back(place, run) and live is not None and _is_member(live, worker):
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
        desk = self._aggregator.reception.desk
        for name, worker in sorted(place for place in expected if not desk.is_here(place)):
            desk.roll.forget((name, worker))
            live = self._aggregator.crowds.get(name)
            if live is not None and _is_member(live, worker):
                self._aggregator.happen(live, MemberLeft(worker))


def _is_member(live: LiveCrowd, worker: str) -> bool:
    return live.crowd is not None and worker in live.crowd.members


def _comes_back(live: LiveCrowd, worker: str) -> bool:
    missing = live.crowd is not None and worker not in live.crowd.members
    return missing and worker in live.known and not live.finished
