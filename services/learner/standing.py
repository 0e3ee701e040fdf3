"""How a learner does, for whoever runs it: its sessions, what became of their answers, its commits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from protocol.messages import LabelTotals
from protocol.translate import label_totals
from services.runtime.status import StatusDesk
from sfid_core.session.state import Phase

if TYPE_CHECKING:
    from services.learner.service import Learner
    from services.runtime.bus import Request
    from services.runtime.clock import Clock


class Standing:
    """Answers requests for the learner's status, on the loop's thread."""

    def __init__(self, learner: Learner, clock: Clock) -> None:
        self._learner = learner
        name = f"shard-{learner.config.shard}"
        self.key = learner.keys.status("learner", name)
        self._desk = StatusDesk("learner", name, clock, self._facts)

    def reply(self, request: Request) -> None:
        """Answer a request for the status."""
        self._desk.reply(request)

    def _facts(self) -> dict[str, Any]:
        learner = self._learner
        lives = learner.sessions.values()
        return {
            "backlog": learner.loop.waiting,
            "sessions": len(lives),
            "shards": learner.config.shards,
            "running": sum(live.session.phase is not Phase.FINISHED for live in lives),
            "teachers": sum(len(live.session.teachers) for live in lives),
            "labels": total([label_totals(live.session.counts) for live in lives]),
            "refused": learner.reception.desk.refusals(),
            **learner.loop.commits.facts(),
        }


def total(parts: list[LabelTotals]) -> LabelTotals:
    """Return the sums of label counts."""
    fields = LabelTotals.__struct_fields__
    return LabelTotals(**{name: sum(getattr(part, name) for part in parts) for name in fields})
