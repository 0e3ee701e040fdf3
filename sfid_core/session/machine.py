"""The session machine: one function over events.

Rule 1: everything that changes a session is in this file.
Rule 2: this file knows no clock, thread, socket, file or unnamed chance. Time arrives as `at_ns` beside each
event, and draws are named by the decision, so a journal of (at_ns, event) replays to the same table on any
machine.

    GATHERING --enough teachers--> BEGINNING --episode began--> decision opens
    asked before the action (labels):  ASKING --quorum, or deadline--> EXECUTING --step taken--> learn
    asked after it (rewards):          EXECUTING --step taken--> ASKING --quorum, or deadline--> learn
    both (guidance, then a reward):    ASKING --> EXECUTING --> ASKING --> learn
    nothing:                           EXECUTING --step taken--> learn
    taken back:                        EXECUTING --step taken--> on, without learning
    learn --running--> next decision opens, or READY while paused
    learn --episode over--> BEGINNING, or FINISHED after the last
    any --restarted--> the same phase with a fresh window; any --stopped--> FINISHED
"""

from collections.abc import Callable, Iterable
from typing import Any

from sfid_core.learning.kernels import Evidence, Learned
from sfid_core.outcome import Outcome
from sfid_core.session.admission import is_open_to, is_plainly_open, why_rejected
from sfid_core.session.config import WindowMode
from sfid_core.session.effects import (
    Acknowledge,
    Announce,
    AnswerCode,
    BeginEpisode,
    Effect,
    EpisodeDone,
    Execute,
    Ignored,
    SessionDone,
    StepDone,
)
from sfid_core.session.events import (
    AnswerGiven,
    EpisodeBegan,
    Event,
    Paused,
    Restarted,
    Resumed,
    StepTaken,
    Stopped,
    TeacherJoined,
    TeacherLeft,
    WindowChanged,
    WindowElapsed,
)
from sfid_core.session.measures import EpisodeTally, StepMeasures
from sfid_core.session.state import Given, Phase, Session
from sfid_core.teaching.answers import AnswerKind
from sfid_core.teaching.merge import SILENCE, merge

Effects = tuple[Effect, ...]

NOTHING_LEARNED = Learned(0.0, 0.0, 0.0)
ANNOUNCE = Announce()
ANNOUNCED: Effects = (ANNOUNCE,)

# Met at every step, where to find a member through its enum costs 50 ns (CPython 3.11).
ASKING, EXECUTING = Phase.ASKING, Phase.EXECUTING
FULL, UNTIL_ANSWERED = WindowMode.FULL, WindowMode.UNTIL_ANSWERED
ABSTAIN, ACCEPTED, RUNNING = AnswerKind.ABSTAIN, AnswerCode.ACCEPTED, Outcome.RUNNING


def advance(session: Session, at_ns: int, event: Event) -> tuple[Session, Effects]:
    """Return the session after `event`, and what its shell must now do.

    The session passed in is consumed: its table is too large to copy at each step, so go on with the one
    returned. An event that is not legal in the phase changes nothing and yields Ignored (an answer:
    Acknowledge with REJECTED).
    """
    return session, _HANDLERS[type(event)](session, at_ns, event)


def replay(session: Session, journal: Iterable[tuple[int, Event]]) -> Session:
    """Return the session after every (at_ns, event) of a journal, effects unperformed."""
    for at_ns, event in journal:
        session, _ = advance(session, at_ns, event)
    return session


def _joined(session: Session, _at_ns: int, event: TeacherJoined) -> Effects:
    if session.phase is Phase.FINISHED:
        return (Ignored("the session is finished"),)
    session.teachers.add(event.teacher)
    if session.phase is Phase.GATHERING:
        return _gather(session)
    return ANNOUNCED


def _gather(session: Session) -> Effects:
    if len(session.teachers) < session.config.teachers_min:
        return ANNOUNCED
    session.phase = Phase.BEGINNING
    return ANNOUNCE, BeginEpisode(session.episode)


def _left(session: Session, at_ns: int, event: TeacherLeft) -> Effects:
    if event.teacher not in session.teachers:
        return (Ignored("not present"),)
    session.teachers.discard(event.teacher)
    return (ANNOUNCE, *_close_if_answered(session, at_ns))


def _began(session: Session, at_ns: int, event: EpisodeBegan) -> Effects:
    if session.phase is not Phase.BEGINNING or event.episode != session.episode:
        return (Ignored("no episode was to begin"),)
    session.state, session.view, session.optimal_steps = event.state, event.view, event.optimal_steps
    session.distance = -1 if event.optimal_steps is None else event.optimal_steps
    session.step, session.tally = 0, EpisodeTally()
    session.learner.begin(session.episode)
    return _open(session, at_ns)


def _open(session: Session, at_ns: int) -> Effects:
    """Pick the action and open the decision; a paused session stays between decisions."""
    if session.paused:
        session.phase = Phase.READY
        return ANNOUNCED
    if session.undo_due:
        return _undo(session, at_ns)
    session.action = session.learner.choose(session.state, session.decision)
    session.opened_at_ns = at_ns
    if session.learner.method.asks_before is not None:
        return _ask(session, at_ns)
    session.phase = EXECUTING
    return ANNOUNCE, Execute(session.decision, session.action)


def _undo(session: Session, at_ns: int) -> Effects:
    """Let the environment take the last step back, as a decision about which nobody is asked."""
    session.action = session.learner.memory.actions
    session.opened_at_ns = at_ns
    session.phase = EXECUTING
    return ANNOUNCE, Execute(session.decision, session.action)


def _forget_answers(session: Session) -> None:
    session.answers.clear()
    session.given = ()
    session.evidence = session.transition = None


def _ask(session: Session, at_ns: int) -> Effects:
    """Open the window of the decision for its whole span."""
    session.phase = ASKING
    session.asked_at_ns = at_ns
    session.elapsed_ns = session.uncounted_ns = 0
    _set_deadline(session, at_ns)
    return ANNOUNCED


def _set_deadline(session: Session, at_ns: int) -> None:
    """Let the window, of which `elapsed_ns` have passed, run on from now."""
    endless = session.window.mode is UNTIL_ANSWERED
    passed_ns = session.elapsed_ns - session.uncounted_ns
    deadline_ns = None if endless else at_ns + session.window.span_ms * 1_000_000 - passed_ns
    session.deadline_ns = None if session.paused else deadline_ns
    session.deadlines.note(session.decision, deadline_ns)


def _answer(session: Session, at_ns: int, event: AnswerGiven) -> Effects:
    counts, counted = session.counts, event.answer.kind is not ABSTAIN
    counts.submitted += counted
    if not is_plainly_open(session, event):
        reason = why_rejected(session, event)
        if reason:
            counts.rejected += counted
            return (Acknowledge(event.answer_id, AnswerCode.REJECTED, reason),)
        if not is_open_to(session, event):
            return (Acknowledge(event.answer_id, _too_late(session, at_ns, event, counted=counted)),)
    before = session.answers.get(event.teacher)
    if before is not None and before.answer.kind is not ABSTAIN:
        counts.pending -= 1
        counts.superseded += 1
    counts.pending += counted
    session.answers[event.teacher] = Given(event.answer, at_ns)
    return (Acknowledge(event.answer_id, ACCEPTED), *_close_if_answered(session, at_ns))


def _too_late(session: Session, at_ns: int, event: AnswerGiven, *, counted: bool) -> AnswerCode:
    deadline_ns = session.deadlines.of(event.decision)
    if deadline_ns is None or at_ns <= deadline_ns:
        session.counts.superseded += counted
        return AnswerCode.SUPERSEDED
    session.counts.late += counted
    return AnswerCode.LATE


def _close_if_answered(session: Session, at_ns: int) -> Effects:
    if session.phase is not ASKING or session.paused or session.window.mode is FULL:
        return ()
    if session.window.quorum:
        answered = len(session.answers) >= session.window.quorum
    else:
        answered = bool(session.answers) and session.teachers <= session.answers.keys()
    return _close(session, at_ns) if answered else ()


def _elapsed(session: Session, at_ns: int, _event: WindowElapsed) -> Effects:
    if session.deadline_ns is None or at_ns < session.deadline_ns:
        return (Ignored("no window was due"),)
    return _close(session, at_ns)


def _close(session: Session, at_ns: int) -> Effects:
    """Close the window: merge the answers, then act (asked before the action) or learn (asked after it)."""
    session.deadline_ns = None
    learner, before = session.learner, session.evidence
    given, first_ns = session.standing_answers()
    # Nearly always one; a comprehension is a call (CPython 3.11).
    answers = [given[0][1]] if len(given) == 1 else [answer for _, answer in given]
    evidence = merge(answers, learner.memory.actions, (first_ns - session.asked_at_ns) / 1e6)
    session.given += given
    if session.transition is not None:
        guided = before is not None and before.given
        session.evidence = evidence._replace(guidance=before.guidance) if guided and before else evidence
        return _learn(session, at_ns, session.transition)
    session.evidence = evidence
    if learner.settles:
        session.action = learner.settle(session.state, session.action, evidence, session.decision)
    session.phase = EXECUTING
    return (Execute(session.decision, session.action),)


def _taken(session: Session, at_ns: int, event: StepTaken) -> Effects:
    if event.action >= 0 and event.decision == session.decision and session.transition is None:
        _follow(session, event.action)
    if session.phase is not EXECUTING or event.decision != session.decision:
        return (Ignored("no such step was to be taken"),)
    if session.undo_due:
        return _taken_back(session, at_ns, event)
    if session.learner.method.asks_after is not None:
        session.transition = event
        session.answers.clear()
        return _ask(session, at_ns)
    return _learn(session, at_ns, event)


def _follow(session: Session, action: int) -> None:
    """Let the decision have taken this action, though the table, without erased answers, chooses another."""
    session.action = action
    session.undo_due = action == session.learner.memory.actions
    if session.undo_due and session.phase is ASKING:
        session.phase, session.deadline_ns = EXECUTING, None
        session.counts.set_aside()


def _learn(session: Session, at_ns: int, taken: StepTaken) -> Effects:
    """Update from the transition, then go on."""
    evidence = session.evidence or SILENCE
    learned = session.learner.learn(
        session.state,
        session.action,
        taken.reward,
        evidence,
        taken.state,
        terminal=taken.outcome.terminal,
        step=session.step,
        distances=(session.distance, taken.distance),
        span_ms=(at_ns - session.asked_at_ns) / 1e6,
    )
    undoes = session.learner.undoes(evidence) if taken.undone < 0 else taken.undone == 1
    session.undo_due = taken.outcome is RUNNING and undoes
    return _go_on(session, at_ns, taken, evidence, learned)


def _taken_back(session: Session, at_ns: int, taken: StepTaken) -> Effects:
    """Go on from where the last step began; nothing is learnt from the way back."""
    session.undo_due = False
    return _go_on(session, at_ns, taken, SILENCE, None)


def _go_on(
    session: Session, at_ns: int, taken: StepTaken, evidence: Evidence, learned: Learned | None
) -> Effects:
    """Measure the step, then open the next decision, or end the episode."""
    counts = session.counts
    inputs, counts.pending = counts.pending, 0
    counts.applied += inputs
    session.tally.add(taken.reward, learned, inputs, session.gamma)
    if at_ns > session.opened_at_ns:
        session.teaching_ns += at_ns - session.opened_at_ns
    measures = StepMeasures(
        session.decision,
        session.episode,
        session.step,
        session.state,
        session.view,
        session.action,
        session.given,
        None if evidence.label < 0 else evidence.label,
        taken.reward,
        learned or NOTHING_LEARNED,
        taken.outcome,
        taken.view,
        session.learner.values(session.state),
    )
    session.decision += 1
    session.step += 1
    session.state, session.view, session.distance = taken.state, taken.view, taken.distance
    _forget_answers(session)
    if taken.outcome is RUNNING:
        return (StepDone(measures), *_open(session, at_ns))
    return (StepDone(measures), *_end_episode(session, at_ns, taken))


def _end_episode(session: Session, at_ns: int, taken: StepTaken) -> Effects:
    measures = session.tally.measures(session.episode, session.optimal_steps, taken.outcome)
    session.episodes.append(at_ns, session.decision, measures)
    session.episode += 1
    if session.episode == session.config.episodes:
        return (EpisodeDone(measures), *_finish(session))
    session.phase = Phase.BEGINNING
    return EpisodeDone(measures), BeginEpisode(session.episode)


def _finish(session: Session) -> Effects:
    session.phase = Phase.FINISHED
    session.deadline_ns = None
    session.paused = False
    return ANNOUNCE, SessionDone()


def _window(session: Session, at_ns: int, event: WindowChanged) -> Effects:
    session.window = event.window
    if session.phase is not ASKING:
        return ANNOUNCED
    if not session.paused:
        session.elapsed_ns = at_ns - session.asked_at_ns
    if event.afresh:
        session.uncounted_ns = session.elapsed_ns
    _set_deadline(session, at_ns)
    return (ANNOUNCE, *_close_if_answered(session, at_ns))


def _paused(session: Session, at_ns: int, _event: Paused) -> Effects:
    if session.paused or session.phase is Phase.FINISHED:
        return (Ignored("already paused or finished"),)
    session.paused = True
    session.deadline_ns = None
    if session.phase is ASKING:
        session.elapsed_ns = at_ns - session.asked_at_ns
    return ANNOUNCED


def _resumed(session: Session, at_ns: int, _event: Resumed) -> Effects:
    if not session.paused:
        return (Ignored("not paused"),)
    session.paused = False
    if session.phase is Phase.READY:
        return _open(session, at_ns)
    if session.phase is ASKING:
        # The pause is taken out of the window and of the decision as if it had not been.
        paused_ns = at_ns - session.asked_at_ns - session.elapsed_ns
        session.asked_at_ns += paused_ns
        session.opened_at_ns += paused_ns
        _set_deadline(session, at_ns)
    return (ANNOUNCE, *_close_if_answered(session, at_ns))


def _stopped(session: Session, _at_ns: int, _event: Stopped) -> Effects:
    if session.phase is Phase.FINISHED:
        return (Ignored("already finished"),)
    session.counts.set_aside()
    return _finish(session)


def _restarted(session: Session, at_ns: int, event: Restarted) -> Effects:
    session.epoch = event.epoch
    session.deadlines.clear()
    if session.phase is Phase.GATHERING:
        return _gather(session)
    if session.phase is Phase.BEGINNING:
        return ANNOUNCE, BeginEpisode(session.episode)
    session.opened_at_ns = at_ns
    if session.phase is EXECUTING:
        return ANNOUNCE, Execute(session.decision, session.action)
    return _ask(session, at_ns) if session.phase is ASKING else ANNOUNCED


# mypy cannot tie a key's type to its handler's argument; test_session_machine meets every event in every
# phase.
_HANDLERS: dict[type, Callable[[Session, int, Any], Effects]] = {
    TeacherJoined: _joined,
    TeacherLeft: _left,
    EpisodeBegan: _began,
    AnswerGiven: _answer,
    WindowElapsed: _elapsed,
    StepTaken: _taken,
    WindowChanged: _window,
    Paused: _paused,
    Resumed: _resumed,
    Stopped: _stopped,
    Restarted: _restarted,
}
