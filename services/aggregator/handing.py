"""What a crowd came to goes to the learner: journaled first, then sent until it is acknowledged."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from protocol.codec import encode
from protocol.crowd_forget import said_instead
from protocol.crowd_journal import ClosedRow, CrowdKind, Handed, row_body
from protocol.messages import Answer

if TYPE_CHECKING:
    from random import Random

    from protocol.crowd_journal import AskedRow
    from services.aggregator.live import LiveCrowd
    from services.aggregator.service import Aggregator
    from services.client import AnswerUpdate
    from sfid_core.crowd.round import Concluded
    from sfid_core.teaching.answers import Answer as Said

log = logging.getLogger("sfid.aggregator")


class Handing:
    """Hands on conclusions, on the loop's thread."""

    def __init__(self, aggregator: Aggregator, chance: Random) -> None:
        self._aggregator, self._chance = aggregator, chance

    def concluded(self, live: LiveCrowd, concluded: Concluded, at_ns: int) -> Answer | None:
        """Journal what a round came to; return what is handed on once that is durable, if anything is."""
        asked, message = live.asked, None
        if concluded.answer is not None and asked is not None:
            response_ms = max(0, at_ns - concluded.round.opened_at_ns) // 1_000_000
            message = self._message(concluded.answer, asked, live, response_ms)
            live.handed.append(Handed(message.decision, message.state, asked.asked, encode(message)))
            self._hand_on(live, message)
        row = ClosedRow(
            concluded.round.asked.decision,
            concluded.cause.value,
            len(concluded.round.answers),
            () if concluded.conclusion is None else concluded.conclusion.posterior,
            b"" if message is None else encode(message),
        )
        unique = None if message is None else message.answer_id
        self._aggregator.loop.append(live.name, CrowdKind.CLOSED.value, row_body(row), at_ns, unique)
        return message

    def refused(self, live: LiveCrowd, update: AnswerUpdate) -> None:
        """Take note that the learner did not count a conclusion, and why."""
        live.too_late += 1
        if live.too_late & (live.too_late - 1) == 0:  # 1, 2, 4, 8 ...
            why = update.reason or "the margin is too short"
            what = update.state.value
            log.warning("session %s: conclusion %d was %s: %s", live.name, live.too_late, what, why)

    def _message(self, said: Said, asked: AskedRow, live: LiveCrowd, response_ms: int) -> Answer:
        silent = Answer(
            answer_id=self._chance.randbytes(16),
            session=live.name,
            teacher=live.upstream.name,
            epoch=asked.epoch,
            decision=asked.decision,
            episode=asked.episode,
            step=asked.step,
            state=asked.state,
            kind="abstain",
            response_ms=response_ms,
        )
        return said_instead(silent, said, live.actions)

    def _hand_on(self, live: LiveCrowd, message: Answer) -> None:
        def hand_on() -> None:
            live.upstream.enter()
            live.upstream.send(message)

        self._aggregator.loop.after_commit(hand_on)
