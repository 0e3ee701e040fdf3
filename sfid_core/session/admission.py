"""Which answers a session takes: questions about it that change nothing."""

from sfid_core.session.events import AnswerGiven
from sfid_core.session.state import Phase, Session
from sfid_core.teaching.answers import AnswerKind

NOT_OPEN_YET = "that decision is not open yet"
ASKING, REWARD = Phase.ASKING, AnswerKind.REWARD  # met at every answer; see `machine`


def is_plainly_open(session: Session, event: AnswerGiven) -> bool:
    """Tell whether this is what nearly every answer is: what was asked, in time, of somebody who takes part.

    Then `why_rejected` says nothing and `is_open_to` holds; of any other answer they say what it is.
    """
    method, answer = session.learner.method, event.answer
    return (
        answer.kind is (method.asks_before if session.transition is None else method.asks_after)
        and event.decision == session.decision
        and event.state == session.state
        and session.phase is ASKING
        and event.teacher in session.teachers
        and (answer.kind is not REWARD or answer.action in {None, session.action})
    )


def why_rejected(session: Session, event: AnswerGiven) -> str:
    """Say why an answer answers nothing that was asked, or return an empty text."""
    if event.teacher not in session.teachers and session.phase is not Phase.FINISHED:  # they may come back
        return "join the session before you answer"
    kind = event.answer.kind
    method = session.learner.method
    asked_for = {AnswerKind.ABSTAIN, method.asks_before, method.asks_after}
    if kind not in asked_for and not (kind is AnswerKind.UNDO and method.may_undo):
        asked = session.asks.value if session.asks else "nothing"
        return f"this session asks for {asked}, not {kind.value}"
    if event.decision > session.decision or (
        event.decision == session.decision and _is_unasked(session, kind)
    ):
        return NOT_OPEN_YET
    if event.decision == session.decision and session.phase is ASKING:
        return _why_another(session, event)
    return ""


def is_open_to(session: Session, event: AnswerGiven) -> bool:
    """Tell whether the window that is open now is the one that the answer is for."""
    if session.phase is not ASKING or event.decision != session.decision:
        return False
    if event.answer.kind is AnswerKind.UNDO:
        return session.transition is not None
    return event.answer.kind in {session.asks, AnswerKind.ABSTAIN}


def _why_another(session: Session, event: AnswerGiven) -> str:
    """Say what in the open decision is not what the answer was given for, or return an empty text."""
    if event.state != session.state:
        return "that decision was asked for another state"
    judged = event.answer.action if event.answer.kind is REWARD else None
    return "" if judged in {None, session.action} else "that decision led to another action"


def _is_unasked(session: Session, kind: AnswerKind) -> bool:
    """Tell whether the running decision, or the one that comes next, is still to be asked about."""
    if session.phase in _BEFORE_A_DECISION:
        return True
    asked_before = session.learner.method.asks_before
    if asked_before is None:
        return session.phase is Phase.EXECUTING
    return session.transition is None and kind not in {asked_before, AnswerKind.ABSTAIN}


_BEFORE_A_DECISION = (Phase.GATHERING, Phase.BEGINNING, Phase.READY)
