"""What a crowd came to, as an answer to the learner."""

from protocol.crowd_journal import AskedRow
from protocol.messages import Answer
from services.aggregator.live import LiveCrowd
from sfid_core.teaching.answers import Answer as Said


def handed_answer(said: Said, asked: AskedRow, live: LiveCrowd, answer_id: bytes, response_ms: int) -> Answer:
    """Return the aggregator's answer to what the learner asked."""
    actions = live.actions
    return Answer(
        answer_id=answer_id,
        session=live.name,
        teacher=live.upstream.name,
        epoch=asked.epoch,
        decision=asked.decision,
        episode=asked.episode,
        step=asked.step,
        state=asked.state,
        kind=said.kind.value,
        action=None if said.action is None else actions[said.action],
        reward=said.reward,
        guidance=tuple(actions[action] for action in said.guidance),
        posterior=dict(zip(actions, said.posterior, strict=True)) if said.posterior else None,
        response_ms=response_ms,
    )
