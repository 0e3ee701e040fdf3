"""What a crowd came to, as an answer to the learner."""

from protocol.messages import Answer, Decision
from sfid_core.teaching.answers import Answer as Said


def handed_answer(said: Said, asked: Decision, name: str, answer_id: bytes, response_ms: int) -> Answer:
    """Return the aggregator's answer to a decision of the learner."""
    actions = asked.actions
    return Answer(
        answer_id=answer_id,
        session=asked.session,
        teacher=name,
        epoch=asked.epoch,
        decision=asked.decision,
        episode=asked.episode,
        step=asked.step,
        state=asked.state,
        kind=said.kind.value,
        action=None if said.action is None else actions[said.action],
        reward=said.reward,
        posterior=dict(zip(actions, said.posterior, strict=True)) if said.posterior else None,
        response_ms=response_ms,
    )
