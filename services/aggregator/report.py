"""What is known of a crowd's workers: told to the monitor, and noted in the journal."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

from protocol.codec import encode
from protocol.crowd_journal import CrowdKind, reliability_row, row_body
from protocol.crowd_message import Crowd, WorkerReliability

if TYPE_CHECKING:
    from protocol.messages import Answer
    from services.aggregator.live import LiveCrowd
    from services.aggregator.service import Aggregator
    from sfid_core.crowd.round import Concluded

WORKERS_MAX = 256
"""Workers in one report, who answered last first; about 120 bytes each."""


class Reporter:
    """Publishes the latest report of a crowd, but not too often; notes reliabilities at growing distances."""

    def __init__(self, aggregator: Aggregator) -> None:
        self._aggregator = aggregator

    def learnt(self, live: LiveCrowd, concluded: Concluded, message: Answer | None, at_ns: int) -> None:
        """Take note of a round that is over."""
        for worker in concluded.round.answers:
            live.answered_last.pop(worker, None)
            live.answered_last[worker] = None
        crowd = live.crowd
        if crowd is not None and concluded.conclusion is not None and concluded.conclusion.posterior:
            if crowd.conclusions & (crowd.conclusions - 1) == 0:  # 1, 2, 4, 8 ...: a bounded number of rows
                self.note(live)
            live.report = _report(live, concluded, message, self._aggregator.shard.epoch, at_ns)
            self._publish(live)

    def note(self, live: LiveCrowd) -> None:
        """Journal what is known of every worker."""
        if live.crowd is None:
            return
        loop = self._aggregator.loop
        at_ns = loop.at_ns()
        for kind, aggregate in live.crowd.aggregates.items():
            for worker in aggregate.workers():
                body = row_body(reliability_row(kind, worker, aggregate.reliability(worker)))
                loop.append(live.name, CrowdKind.RELIABILITY.value, body, at_ns, None, worker)

    def _publish(self, live: LiveCrowd) -> None:
        """Publish the latest report, now or when the next one is due."""
        if live.report is None:
            return
        aggregator = self._aggregator
        at_ns = aggregator.loop.at_ns()
        due_ns = live.reported_at_ns + aggregator.config.report_every_ms * 1_000_000
        if at_ns >= due_ns:
            report, live.report, live.reported_at_ns = live.report, None, at_ns
            aggregator.bus.publish(
                aggregator.learners.crowd(live.name, aggregator.config.name), encode(report)
            )
        else:
            aggregator.loop.call_at(due_ns, self._publish, live)


def _report(live: LiveCrowd, concluded: Concluded, message: Answer | None, epoch: int, at_ns: int) -> Crowd:
    """Return a crowd as it stands after a decision."""
    crowd = live.crowd
    assert crowd is not None  # noqa: S101 - told to the type checker: it has just concluded
    return Crowd(
        session=live.name,
        aggregator=live.upstream.name,
        epoch=epoch,
        decision=concluded.round.asked.decision,
        at_ns=at_ns,
        cause=concluded.cause.value,
        members=len(crowd.members),
        answered=len(concluded.round.answers),
        action=None if message is None else message.action,
        posterior=None if message is None else message.posterior,
        conclusions=crowd.conclusions,
        too_late=live.too_late,
        workers=_workers(live, concluded),
    )


def _workers(live: LiveCrowd, concluded: Concluded) -> tuple[WorkerReliability, ...]:
    crowd = live.crowd
    assert crowd is not None  # noqa: S101 - as above
    aggregate = crowd.aggregate(concluded.round.asked.kind)
    known = [
        (worker, aggregate.reliability(worker))
        for worker in islice(reversed(live.answered_last), WORKERS_MAX)
    ]
    return tuple(
        WorkerReliability(
            worker=worker,
            mean=reliability.mean,
            standard_error=reliability.standard_error,
            labels=reliability.labels,
            standing=reliability.standing.value,
            present=worker in crowd.members,
        )
        for worker, reliability in known
    )
