"""Who said what, when it was shown and when it was answered: one table over the journals of both sides.

A row's time is of the clock of whoever wrote it, the teacher's `response_ms` a span on the teacher's own:
clocks of two machines are never compared. What was asked at A, arrived at B and took R from the showing to
the answer was shown between A and B - R, and answered between A + R and B.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from protocol.codec import decode
from protocol.crowd_journal import AskedRow, ClosedRow, CrowdKind, read_body
from protocol.journal import Kind, Record, read_answer_body
from protocol.messages import Answer


@dataclass(frozen=True, slots=True)
class Saying:
    """One answer of one teacher. Times are ns since 1970 on the clock of who kept the journal."""

    answer_id: bytes
    session: str
    teacher: str
    decision: int
    episode: int
    step: int
    kind: str
    action: str | None
    reward: float | None
    code: str
    asked_at_ns: int | None
    """When the decision was announced; None where the journal does not say."""
    arrived_at_ns: int
    response_ms: int | None
    via: str = ""
    """The aggregator that it was said to; empty: the learner itself."""
    handed: bytes = b""
    """The id of the answer to the learner that it went into; empty where it went into none."""

    @property
    def shown_ns(self) -> tuple[int, int] | None:
        """When the teacher was shown the decision: at the earliest, at the latest."""
        if self.asked_at_ns is None:
            return None
        return self.asked_at_ns, max(self.asked_at_ns, self.arrived_at_ns - self._response_ns)

    @property
    def answered_ns(self) -> tuple[int, int] | None:
        """When the teacher answered: at the earliest, at the latest."""
        if self.asked_at_ns is None:
            return None
        return min(self.arrived_at_ns, self.asked_at_ns + self._response_ns), self.arrived_at_ns

    @property
    def _response_ns(self) -> int:
        return (self.response_ms or 0) * 1_000_000


def said_to_a_learner(records: Iterable[Record]) -> Iterator[Saying]:
    """Yield every answer in a learner's journal of one session, in order.

    Raises: DecodeError when a body cannot be read.
    """
    opened_ns: dict[int, int] = {}
    taken_ns: dict[int, int] = {}
    decision = 0
    for kind, at_ns, body in records:
        if kind == Kind.BEGAN.value:
            opened_ns[decision] = at_ns
        elif kind == Kind.STEP.value:
            taken_ns[decision] = at_ns
            decision += 1
            opened_ns[decision] = at_ns
        elif kind == Kind.ANSWER.value:
            code, _, payload = read_answer_body(body)
            message = decode(payload, Answer)
            asked_ns = taken_ns if message.kind == "reward" else opened_ns
            yield _saying(message, code.value, asked_ns.get(message.decision), at_ns)


def said_to_a_crowd(records: Iterable[Record], aggregator: str) -> Iterator[Saying]:
    """Yield every answer in an aggregator's journal of one session: late ones at once, others by their round.

    Raises: DecodeError when a body cannot be read.
    """
    asked_ns: dict[int, int] = {}
    in_round: list[Saying] = []
    for kind, at_ns, body in records:
        if kind == CrowdKind.ASKED.value:
            asked_ns[read_body(kind, body, AskedRow).decision] = at_ns
        elif kind == CrowdKind.ANSWER.value:
            code, _, payload = read_answer_body(body)
            message = decode(payload, Answer)
            saying = _saying(message, code.value, asked_ns.get(message.decision), at_ns)
            in_round.append(replace(saying, via=aggregator))
        elif kind == CrowdKind.CLOSED.value:
            yield from _counted(in_round, read_body(kind, body, ClosedRow))
            in_round = []
    yield from in_round


def _counted(in_round: list[Saying], closed: ClosedRow) -> Iterator[Saying]:
    """Yield a round's answers; the last accepted one of each worker went into what was handed on."""
    handed = decode(closed.handed, Answer).answer_id if closed.handed else b""
    last = {
        saying.teacher: saying.answer_id
        for saying in in_round
        if saying.code == "accepted" and saying.decision == closed.decision
    }
    for saying in in_round:
        counted = last.get(saying.teacher) == saying.answer_id
        yield replace(saying, handed=handed) if counted else saying


def _saying(message: Answer, code: str, asked_at_ns: int | None, at_ns: int) -> Saying:
    return Saying(
        message.answer_id, message.session, message.teacher, message.decision, message.episode, message.step,
        message.kind, message.action, message.reward, code, asked_at_ns, at_ns, message.response_ms,
    )  # fmt: skip
