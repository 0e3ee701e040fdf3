"""What a crowd came to, as an answer to the learner."""

from protocol.crowd_forget import said_instead
from protocol.crowd_journal import AskedRow
from protocol.messages import Answer
from services.aggregator.live import LiveCrowd
from sfid_core.teaching.answers import Answer as Said


def handed_answer(said: Said, asked: AskedRow, live: LiveCrowd, answer_id: bytes, response_ms: int) -> Answer:
    """Return the aggregator's answer to what the learner asked."""
    silent = Answer(
        answer_id=answer_id,
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
