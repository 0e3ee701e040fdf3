"""What holds after every event, whatever came before: each event in each phase, and random histories."""

from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sfid_core.outcome import Outcome
from sfid_core.session.config import Window, WindowMode
from sfid_core.session.effects import (
    Acknowledge,
    AnswerCode,
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
from sfid_core.session.machine import advance, replay
from sfid_core.session.state import Phase, Session, new_session
from sfid_core.teaching.answers import Answer, AnswerKind
from tests.core.session.script import (
    EARLY,
    FULL,
    MS,
    PATIENT,
    STATES,
    VIEWS,
    abstention,
    answer_id,
    began,
    configured,
    in_phase,
    label,
    praise,
    snapshot,
    taken,
)

METHODS = ("sfid", "reward", "q-learning")
EVERYWHERE = frozenset(Phase)
RUNNING = EVERYWHERE - {Phase.FINISHED}

EVENTS: list[tuple[Event, frozenset[Phase]]] = [
    (TeacherJoined("bob"), RUNNING),
    (TeacherJoined("ann"), RUNNING),
    (TeacherLeft("ann"), EVERYWHERE - {Phase.GATHERING}),  # nobody is there yet
    (TeacherLeft("eve"), frozenset()),
    (began(0), frozenset({Phase.BEGINNING})),
    (began(1), frozenset()),
    (label("ann", 1), EVERYWHERE),
    (praise("ann", -1.0), EVERYWHERE),
    (abstention("ann"), EVERYWHERE),
    (label("ann", 1, decision=3), EVERYWHERE),
    (WindowElapsed(), frozenset({Phase.ASKING})),
    (taken(0), frozenset({Phase.EXECUTING})),
    (taken(4), frozenset()),
    (WindowChanged("ann", FULL), EVERYWHERE),
    (Paused("ann"), RUNNING - {Phase.READY}),
    (Resumed("ann"), frozenset({Phase.READY})),
    (Stopped("ann"), RUNNING),
    (Restarted(2), EVERYWHERE),
]
"""Each event with the phases in which it is legal; an answer is always answered."""


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("phase", list(Phase), ids=lambda phase: phase.value)
@pytest.mark.parametrize("event, legal_in", EVENTS, ids=lambda value: type(value).__name__)
def test_every_phase_meets_every_event_and_an_illegal_one_changes_nothing(
    method: str, phase: Phase, event: Event, legal_in: frozenset[Phase]
) -> None:
    if (phase, method) == (Phase.ASKING, "q-learning"):
        return  # it never asks
    session = in_phase(phase, method)
    before = snapshot(session)
    _, effects = advance(session, 1000 * MS, event)
    ignored = any(isinstance(effect, Ignored) for effect in effects)
    assert ignored is (phase not in legal_in)
    if ignored:
        assert len(effects) == 1
        assert snapshot(session) == before


# --- random histories ---

TEACHERS = st.sampled_from(["ann", "bob", "cid"])
WINDOWS = st.sampled_from([EARLY, FULL, PATIENT, Window(WindowMode.EARLY, 20, 2), Window(WindowMode.FULL, 5)])
ANSWERS = st.one_of(
    st.builds(Answer, st.just(AnswerKind.LABEL), st.integers(0, 3)),
    st.builds(lambda reward: Answer(AnswerKind.REWARD, reward=reward), st.sampled_from([-1.0, 0.0, 1.0])),
    st.just(Answer(AnswerKind.ABSTAIN)),
)


@dataclass(frozen=True)
class Blueprint:
    """An event still to be tied to where the session stands."""

    kind: str
    teacher: str
    answer: Answer
    behind: int
    """How many decisions behind (or, negative, ahead of) the session it is; 0 mostly."""
    outcome: Outcome
    window: Window
    number: int

    def event(self, session: Session) -> Event:
        decision = max(0, session.decision - self.behind)
        state = session.state if self.behind == 0 else STATES[self.number]
        events: dict[str, Event] = {
            "joined": TeacherJoined(self.teacher),
            "left": TeacherLeft(self.teacher),
            "began": EpisodeBegan(session.episode - self.behind, STATES[self.number], VIEWS[0], self.number),
            "answer": AnswerGiven(self.teacher, answer_id(self.number), decision, state, self.answer),
            "elapsed": WindowElapsed(),
            "taken": StepTaken(decision, 1.0, self.outcome, STATES[self.number], VIEWS[self.number]),
            "window": WindowChanged(self.teacher, self.window),
            "paused": Paused(self.teacher),
            "resumed": Resumed(self.teacher),
            "stopped": Stopped(self.teacher),
            "restarted": Restarted(session.epoch + 1),
        }
        return events[self.kind]


KINDS = (
    ["answer"] * 8 + ["taken"] * 6 + ["began"] * 4 + ["elapsed"] * 3 + ["joined"] * 2 + ["resumed"] * 2
    + ["left", "window", "paused", "restarted", "stopped"]
)  # fmt: skip
BLUEPRINTS = st.builds(
    Blueprint,
    kind=st.sampled_from(KINDS),
    teacher=TEACHERS,
    answer=ANSWERS,
    behind=st.sampled_from([0, 0, 0, 0, 0, 0, 1, 1, 2, -1]),
    outcome=st.sampled_from([Outcome.RUNNING, Outcome.RUNNING, *Outcome]),
    window=WINDOWS,
    number=st.integers(0, 7),
)
HISTORIES = st.lists(st.tuples(st.integers(0, 700), BLUEPRINTS), min_size=1, max_size=60)


@dataclass
class Witness:
    """What a watcher of the effects alone knows; it shares no code with the machine."""

    executed: set[int] = field(default_factory=set)
    learnt: int = 0
    inputs: int = 0
    episodes: int = 0
    over: bool = False

    def see(self, event: Event, effects: tuple[Effect, ...]) -> None:
        acknowledged = [effect for effect in effects if isinstance(effect, Acknowledge)]
        expected = [event.answer_id] if isinstance(event, AnswerGiven) else []
        assert [effect.answer_id for effect in acknowledged] == expected
        for effect in effects:
            if isinstance(effect, Execute):
                assert effect.decision == self.learnt, (
                    "only the decision that is to be learnt next is executed"
                )
                assert effect.decision not in self.executed or isinstance(event, Restarted)
                self.executed.add(effect.decision)
            elif isinstance(effect, StepDone):
                assert effect.measures.decision == self.learnt
                assert effect.measures.decision in self.executed
                self.learnt += 1
                said = effect.measures.answers
                self.inputs += sum(answer.kind is not AnswerKind.ABSTAIN for _, answer in said)
            elif isinstance(effect, EpisodeDone):
                assert effect.measures.episode == self.episodes
                self.episodes += 1
            elif isinstance(effect, SessionDone):
                assert not self.over
                self.over = True


def check(session: Session, witness: Witness) -> None:
    counts = session.counts
    settled = counts.applied + counts.superseded + counts.late + counts.rejected
    assert counts.submitted == settled + counts.pending
    assert counts.submitted == counts.acknowledged + counts.rejected
    waiting = sum(given.answer.kind is not AnswerKind.ABSTAIN for given in session.answers.values())
    assert counts.pending == (waiting if session.phase in {Phase.ASKING, Phase.EXECUTING} else 0)
    assert counts.applied == witness.inputs
    runs = (
        session.phase is Phase.ASKING
        and not session.paused
        and session.window.mode is not WindowMode.UNTIL_ANSWERED
    )
    assert (session.deadline_ns is not None) is runs
    assert (session.phase is Phase.ASKING) <= (session.asks is not None)
    assert (session.phase is Phase.READY) <= session.paused
    assert (session.phase is Phase.FINISHED) is witness.over
    assert session.decision == witness.learnt
    assert (session.episode, len(session.episodes)) == (witness.episodes, witness.episodes)
    assert sum(episode.steps for episode in session.episodes) <= witness.learnt
    assert session.teaching_ns >= 0
    assert len(session.deadlines) <= 16


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=300, deadline=None)
@given(history=HISTORIES, window=WINDOWS, teachers_min=st.integers(0, 2))
def test_the_invariants_hold_after_every_event_of_any_history(
    method: str, history: list[tuple[int, Blueprint]], window: Window, teachers_min: int
) -> None:
    config = configured(method, window, episodes=3, teachers_min=teachers_min)
    session, witness, at_ns = new_session(config), Witness(), 0
    journal: list[tuple[int, Event]] = []
    for after_ms, blueprint in history:
        at_ns += after_ms * MS
        event = blueprint.event(session)
        journal.append((at_ns, event))
        session, effects = advance(session, at_ns, event)
        witness.see(event, effects)
        check(session, witness)
    assert snapshot(replay(new_session(config), journal)) == snapshot(session)


@settings(max_examples=100, deadline=None)
@given(history=HISTORIES)
def test_an_event_that_is_ignored_or_rejected_leaves_everything_but_the_counts(
    history: list[tuple[int, Blueprint]],
) -> None:
    session, at_ns = new_session(configured(episodes=3)), 0
    for after_ms, blueprint in history:
        at_ns += after_ms * MS
        before = snapshot(session)
        session, effects = advance(session, at_ns, blueprint.event(session))
        refused = isinstance(effects[0], Ignored) or (
            isinstance(effects[0], Acknowledge) and effects[0].code is not AnswerCode.ACCEPTED
        )
        if refused:
            assert snapshot(session) | {"counts": None} == before | {"counts": None}
