"""One decision after another put to a crowd: `advance` takes what happens and says what follows.

Rule 1: the last answer of a worker before the close counts, once.
Rule 2: a round closes when the quorum has answered, or a margin before the learner's deadline, whichever is
first. A quorum of 0 is everybody present: who leaves is not waited for. A learner without a deadline is given
one by the first answer and the crowd's patience, so nobody who stays silent holds up the others.
Rule 3: answers that all abstain, that tie, or that leave the best action below `abstain_below` are handed on
as an abstention; a round without any answer hands on nothing.
Rule 4: labels and rewards are weighed by whom the crowd has learnt to believe; of guidance the actions count
that more than half of those who guide name, of mistake marks the one that most make, a tie being silence.
Rule 5: every closing is an event, so a journal of events builds the same reliabilities, with or without
somebody's answers in it.

    no round --asked--> open --answers; quorum, deadline or overtaken: closed--> no round
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

from sfid_core.crowd.online import Conclusion, OnlineAggregate
from sfid_core.crowd.settings import CrowdSettings
from sfid_core.learning.parameters import ParameterError
from sfid_core.session.effects import AnswerCode
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import merge_guidance, merge_marks

ROUNDS_KEPT = 16
"""Closed rounds whose deadline is remembered, to tell superseded answers from late ones."""
MARGIN_SHARE = 4
"""The margin takes at most this part of what is left of a window: a quarter."""
PRAISE, BLAME = 0, 1
"""The two classes of a crowd that is asked for rewards."""


class Cause(StrEnum):
    """Why a round was closed."""

    QUORUM = "quorum"
    DEADLINE = "deadline"
    OVERTAKEN = "overtaken"
    """The learner went on without this crowd; the answers are learnt from, and nothing is handed on."""


@dataclass(frozen=True, slots=True)
class RoundSettings:
    """When a round closes. Raises: ParameterError."""

    quorum: int = 0
    """Answers that close a round; 0 means everybody who is present, and at least one."""
    margin_ms: int = 100
    """How long before the learner's deadline a round closes, at most a quarter of what is left."""
    patience_ms: int = 5_000
    """How long after the first answer a round without a deadline stays open."""

    def __post_init__(self) -> None:
        if self.quorum < 0:
            raise ParameterError(
                f"quorum {self.quorum} is negative: use 0 for everybody present, or a number"
            )
        if not 0 <= self.margin_ms <= 60_000:
            raise ParameterError(f"margin_ms {self.margin_ms} is outside 0 to 60000: 100 is usual")
        if not 1 <= self.patience_ms <= 3_600_000:
            raise ParameterError(f"patience_ms {self.patience_ms} is outside 1 to 3600000: 5000 is usual")


# ---------------------------------------------------------------- events


class MemberJoined(NamedTuple):
    """A worker is present."""

    worker: str


class MemberLeft(NamedTuple):
    """A worker is gone; what they have answered stays."""

    worker: str


class Asked(NamedTuple):
    """The learner asks; the same question again changes only the time that is left.

    A decision has two questions where teachers are asked before and after the action.
    """

    decision: int
    state: bytes
    kind: AnswerKind
    judged: int | None = None
    """The action that a reward judges."""
    remaining_ms: int | None = None
    """Until the learner's deadline; None: it has none, or is paused."""
    full: bool = False
    """The learner waits out the whole window: a quorum closes nothing."""
    held: bool = False
    """The session is paused: nothing closes."""
    optimal: tuple[int, ...] = ()
    """The optimal actions, where somebody knows them; empty where nobody does."""
    gold: bool = False
    """Whether the single optimal action serves to measure the workers."""


class Answered(NamedTuple):
    """A worker's answer arrived, for the first time under this id."""

    worker: str
    answer_id: bytes
    decision: int
    state: bytes
    answer: Answer


class Closed(NamedTuple):
    """The open round ends here."""

    cause: Cause


Event = MemberJoined | MemberLeft | Asked | Answered | Closed

# ---------------------------------------------------------------- effects


class Acknowledged(NamedTuple):
    """Tell the worker what became of the answer, once it is durable."""

    answer_id: bytes
    code: AnswerCode
    reason: str = ""


class Due(NamedTuple):
    """The round is to be closed now: send Closed."""

    cause: Cause


class Concluded(NamedTuple):
    """A round is over."""

    round: "Round"
    cause: Cause
    answer: Answer | None
    """What is handed on to the learner; None: nothing."""
    conclusion: Conclusion | None
    """What the answers came to; None without any."""


class Announce(NamedTuple):
    """Publish the decision as the crowd is to see it."""


Effect = Acknowledged | Due | Concluded | Announce


# ---------------------------------------------------------------- state


@dataclass(slots=True)
class Round:
    """One decision put to the crowd. Times are ns on the owner's steady clock."""

    asked: Asked
    opened_at_ns: int
    deadline_ns: int | None = None
    answers: dict[str, Answer] = field(default_factory=dict)
    """By worker; the last of each."""


@dataclass(slots=True)
class Crowd:
    """A crowd of one session between two events; changed by `advance` alone."""

    settings: RoundSettings
    weighing: CrowdSettings
    actions: int
    """How many actions the session has."""
    members: set[str] = field(default_factory=set)
    round: Round | None = None
    closed: dict[tuple[int, AnswerKind], int | None] = field(default_factory=dict)
    """Deadlines of the latest closed rounds by decision and what was asked."""
    conclusions: int = 0
    """Rounds that were learnt from."""
    aggregates: dict[AnswerKind, OnlineAggregate] = field(default_factory=dict)

    def aggregate(self, kind: AnswerKind) -> OnlineAggregate:
        """Return what weighs answers of this kind: over the actions, or over praise and blame."""
        if kind not in self.aggregates:
            classes = 2 if kind is AnswerKind.REWARD else self.actions
            self.aggregates[kind] = OnlineAggregate(classes, self.weighing)
        return self.aggregates[kind]


def advance(crowd: Crowd, at_ns: int, event: Event) -> tuple[Effect, ...]:
    """Change the crowd by an event and return what its shell must now do."""
    return _HANDLERS[type(event)](crowd, at_ns, event)


def _joined(crowd: Crowd, _at_ns: int, event: MemberJoined) -> tuple[Effect, ...]:
    crowd.members.add(event.worker)
    return (Announce(),)


def _left(crowd: Crowd, _at_ns: int, event: MemberLeft) -> tuple[Effect, ...]:
    if event.worker not in crowd.members:
        return ()
    crowd.members.discard(event.worker)
    return (Announce(), *_due(crowd))


def _asked(crowd: Crowd, at_ns: int, event: Asked) -> tuple[Effect, ...]:
    open_round = crowd.round
    if open_round is None or open_round.asked[:3] != event[:3]:
        crowd.round = open_round = Round(event, at_ns)
        # A learner that was killed asks again what it had not kept.
        again = [
            known
            for known in crowd.closed
            if known == (event.decision, event.kind) or known[0] > event.decision
        ]
        for known in again:
            del crowd.closed[known]
    else:
        # What the optimal actions are was settled when the round opened.
        open_round.asked = event._replace(optimal=open_round.asked.optimal, gold=open_round.asked.gold)
    _set_deadline(crowd.settings, open_round, at_ns)
    return (Announce(), *_due(crowd))


def _set_deadline(settings: RoundSettings, open_round: Round, at_ns: int) -> None:
    remaining_ms = open_round.asked.remaining_ms
    if open_round.asked.held:
        open_round.deadline_ns = None
    elif remaining_ms is not None:
        margin_ms = min(settings.margin_ms, remaining_ms // MARGIN_SHARE)
        open_round.deadline_ns = at_ns + (remaining_ms - margin_ms) * 1_000_000
    elif not open_round.answers:
        open_round.deadline_ns = None
    elif open_round.deadline_ns is None:
        open_round.deadline_ns = at_ns + settings.patience_ms * 1_000_000


def _answered(crowd: Crowd, at_ns: int, event: Answered) -> tuple[Effect, ...]:
    open_round = crowd.round
    earlier = (event.decision, event.answer.kind) in crowd.closed
    if open_round is None or event.decision != open_round.asked.decision or earlier:
        return (_not_open(crowd, at_ns, event),)
    reason = _why_rejected(open_round.asked, event)
    if reason:
        return (Acknowledged(event.answer_id, AnswerCode.REJECTED, reason),)
    open_round.answers[event.worker] = event.answer
    if open_round.asked.remaining_ms is None:
        _set_deadline(crowd.settings, open_round, at_ns)
    return (Acknowledged(event.answer_id, AnswerCode.ACCEPTED), *_due(crowd))


def _not_open(crowd: Crowd, at_ns: int, event: Answered) -> Acknowledged:
    open_round = crowd.round
    newest = max((known[0] for known in crowd.closed), default=-1)
    if event.decision > (newest if open_round is None else open_round.asked.decision):
        return Acknowledged(event.answer_id, AnswerCode.REJECTED, "that decision is not open yet")
    deadlines = [deadline_ns for known, deadline_ns in crowd.closed.items() if known[0] == event.decision]
    deadline_ns = crowd.closed.get((event.decision, event.answer.kind), deadlines[-1] if deadlines else 0)
    in_time = deadline_ns is None or at_ns <= deadline_ns
    return Acknowledged(event.answer_id, AnswerCode.SUPERSEDED if in_time else AnswerCode.LATE)


def _why_rejected(asked: Asked, event: Answered) -> str:
    kind = event.answer.kind
    if kind is not AnswerKind.ABSTAIN and kind is not asked.kind:
        return f"this session asks for {asked.kind.value}, not {kind.value}"
    if event.state != asked.state:
        return "that decision was asked for another state"
    if kind is AnswerKind.REWARD and event.answer.action not in {None, asked.judged}:
        return "that decision led to another action"
    return ""


def _due(crowd: Crowd) -> tuple[Effect, ...]:
    """Say that the quorum has answered, if it has."""
    open_round = crowd.round
    if open_round is None or open_round.asked.held or open_round.asked.full or not open_round.answers:
        return ()
    if crowd.settings.quorum:
        answered = len(open_round.answers) >= crowd.settings.quorum
    else:
        answered = crowd.members <= open_round.answers.keys()
    return (Due(Cause.QUORUM),) if answered else ()


def _closed(crowd: Crowd, _at_ns: int, event: Closed) -> tuple[Effect, ...]:
    open_round = crowd.round
    if open_round is None:
        return ()
    crowd.round = None
    crowd.closed[open_round.asked.decision, open_round.asked.kind] = open_round.deadline_ns
    if len(crowd.closed) > ROUNDS_KEPT:
        del crowd.closed[next(iter(crowd.closed))]
    conclusion = _concluded(crowd, open_round)
    silent = conclusion is None or event.cause is Cause.OVERTAKEN
    answer = (
        None if conclusion is None or silent else _answer(open_round.asked, open_round.answers, conclusion)
    )
    return Concluded(open_round, event.cause, answer, conclusion), Announce()


def _concluded(crowd: Crowd, over: Round) -> Conclusion | None:
    """Weigh a round's answers and learn from them; None without any."""
    if not over.answers:
        return None
    asked = over.asked
    if asked.kind not in (AnswerKind.LABEL, AnswerKind.REWARD):  # a vote each; nobody's reliability is learnt
        return Conclusion((), None, {})
    aggregate = crowd.aggregate(asked.kind)
    labels = {worker: _class_of(over.answers[worker]) for worker in sorted(over.answers)}
    conclusion = aggregate.conclude(labels)
    if any(label is not None for label in labels.values()):
        optimal = frozenset(asked.optimal) if asked.kind is AnswerKind.LABEL else frozenset()
        gold = min(optimal) if asked.gold and len(optimal) == 1 else None
        aggregate.learn(labels, acceptable=optimal or None, gold=gold)
        crowd.conclusions += 1
    return conclusion


def _class_of(answer: Answer) -> int | None:
    """Return the class that an answer names; a reward of exactly 0 names none, as an abstention."""
    if answer.kind is AnswerKind.LABEL:
        return answer.action
    if answer.kind is AnswerKind.REWARD and answer.reward:
        return PRAISE if answer.reward > 0 else BLAME
    return None


def _answer(asked: Asked, answers: Mapping[str, Answer], conclusion: Conclusion) -> Answer:
    posterior = conclusion.posterior
    if asked.kind is AnswerKind.MISTAKE:
        return merge_marks(answers.values()) or Answer(AnswerKind.ABSTAIN)
    if asked.kind is AnswerKind.GUIDANCE:
        bits = merge_guidance(answers.values())
        named = tuple(action for action in range(bits.bit_length()) if bits >> action & 1)
        return Answer(AnswerKind.GUIDANCE, guidance=named) if named else Answer(AnswerKind.ABSTAIN)
    if asked.kind is AnswerKind.REWARD:
        if conclusion.action is None:
            return Answer(AnswerKind.ABSTAIN)
        # E[h] of a reward that is +size with probability q and -size otherwise.
        graded = (posterior[PRAISE] - posterior[BLAME]) * _size(answers, conclusion.action)
        return Answer(AnswerKind.REWARD, asked.judged, max(-1.0, min(1.0, graded)))
    if conclusion.action is None:
        return Answer(AnswerKind.ABSTAIN, posterior=posterior)
    return Answer(AnswerKind.LABEL, conclusion.action, posterior=posterior)


def _size(answers: Mapping[str, Answer], side: int) -> float:
    """Return the mean magnitude of the rewards on one side, 1 where nobody is on it."""
    given = [answers[worker] for worker in sorted(answers)]
    sizes = [abs(answer.reward or 0.0) for answer in given if _class_of(answer) == side]
    return sum(sizes) / len(sizes) if sizes else 1.0


# mypy cannot tie a key's type to its handler's argument; the tests meet every event.
_HANDLERS: dict[type, Callable[[Crowd, int, Any], tuple[Effect, ...]]] = {
    MemberJoined: _joined,
    MemberLeft: _left,
    Asked: _asked,
    Answered: _answered,
    Closed: _closed,
}
