"""The session machine as tables: (state, event) -> effects, each compared whole."""

import pytest

from sfid_core.learning.kernels import Learned
from sfid_core.outcome import Outcome
from sfid_core.session.effects import (
    Acknowledge,
    Announce,
    AnswerCode,
    BeginEpisode,
    EpisodeDone,
    Execute,
    Ignored,
    SessionDone,
    StepDone,
)
from sfid_core.session.events import (
    Restarted,
    Stopped,
    TeacherJoined,
    TeacherLeft,
    WindowElapsed,
)
from sfid_core.session.measures import EpisodeMeasures, StepMeasures
from sfid_core.session.state import Phase, Session, new_session
from sfid_core.teaching.answers import Answer, AnswerKind
from sfid_core.teaching.merge import SILENCE
from tests.core.session.script import (
    FULL,
    STATES,
    VIEWS,
    abstention,
    answer_id,
    asked,
    began,
    configured,
    in_phase,
    label,
    play,
    praise,
    taken,
)


def row(action: int, value: float) -> tuple[float, ...]:
    return tuple(value if index == action else 0.0 for index in range(4))


def test_a_label_closes_the_window_the_agent_acts_as_it_chose_and_learns_from_both_rewards() -> None:
    session = new_session(configured(episodes=1))
    agent = session.learner.choose(STATES[0], 0)
    played = play(
        session,
        [
            (0, TeacherJoined("ann")),
            (10, began()),
            (30, label("ann", agent)),
            (40, taken(reward=10.0, outcome=Outcome.SOLVED)),
        ],
    )
    answer = Answer(AnswerKind.LABEL, action=agent)
    learned = Learned(10.0, 11.0, 1.0)
    step = StepMeasures(
        0,
        0,
        0,
        STATES[0],
        VIEWS[0],
        agent,
        (("ann", answer),),
        agent,
        10.0,
        learned,
        Outcome.SOLVED,
        VIEWS[1],
        row(agent, 0.1 * 11.0),
    )
    episode = EpisodeMeasures(0, 1, 3, 10.0, 11.0, 11.0, 10.0, 1, 1, Outcome.SOLVED)
    assert played == [
        (Announce(), BeginEpisode(0)),
        (Announce(),),
        (Acknowledge(answer_id(0), AnswerCode.ACCEPTED), Execute(0, agent)),
        (StepDone(step), EpisodeDone(episode), Announce(), SessionDone()),
    ]
    assert session.phase is Phase.FINISHED
    assert session.teaching_ns == 30_000_000


def test_a_reward_is_asked_for_after_the_action_was_seen_and_is_learnt_with_the_step() -> None:
    session = new_session(configured("reward", episodes=1))
    agent = session.learner.choose(STATES[0], 0)
    played = play(
        session,
        [
            (0, TeacherJoined("ann")),
            (10, began()),
            (20, taken(reward=-10.0, outcome=Outcome.DEADLOCK)),
            (30, praise("ann", -1.0)),
        ],
    )
    answer = Answer(AnswerKind.REWARD, reward=-1.0)
    step = StepMeasures(
        0,
        0,
        0,
        STATES[0],
        VIEWS[0],
        agent,
        (("ann", answer),),
        None,
        -10.0,
        Learned(-10.0, -11.0, -1.0),
        Outcome.DEADLOCK,
        VIEWS[1],
        row(agent, 0.1 * -11.0),
    )
    episode = EpisodeMeasures(0, 1, 3, 10.0, 11.0, -11.0, -10.0, 1, 0, Outcome.DEADLOCK)
    assert played == [
        (Announce(), BeginEpisode(0)),
        (Announce(), Execute(0, agent)),
        (Announce(),),
        (
            Acknowledge(answer_id(0), AnswerCode.ACCEPTED),
            StepDone(step),
            EpisodeDone(episode),
            Announce(),
            SessionDone(),
        ),
    ]


def test_q_learning_asks_nobody_and_learns_from_the_environment_alone() -> None:
    session = new_session(configured("q-learning", episodes=1))
    agent = session.learner.choose(STATES[0], 0)
    played = play(session, [(0, TeacherJoined("ann")), (10, began()), (20, taken(reward=2.0))])
    step = StepMeasures(
        0,
        0,
        0,
        STATES[0],
        VIEWS[0],
        agent,
        (),
        None,
        2.0,
        Learned(2.0, 2.0, 0.0),
        Outcome.RUNNING,
        VIEWS[1],
        row(agent, 0.2),
    )
    following = session.learner.choose(STATES[1], 1)
    assert played == [
        (Announce(), BeginEpisode(0)),
        (Announce(), Execute(0, agent)),
        (StepDone(step), Announce(), Execute(1, following)),
    ]


def test_the_session_waits_for_as_many_teachers_as_it_was_told_to() -> None:
    session = new_session(configured(teachers_min=2))
    assert play(
        session, [(0, TeacherJoined("ann")), (0, TeacherJoined("ann")), (0, TeacherJoined("bob"))]
    ) == [
        (Announce(),),
        (Announce(),),
        (Announce(), BeginEpisode(0)),
    ]


def test_a_session_that_needs_no_teacher_begins_when_its_learner_takes_it_up() -> None:
    session = new_session(configured(teachers_min=0))
    assert play(session, [(0, Restarted(1))]) == [(Announce(), BeginEpisode(0))]


def test_silence_until_the_deadline_is_learnt_as_no_reward_from_the_teacher() -> None:
    session = asked()
    agent = session.action
    played = play(session, [(999, WindowElapsed()), (1000, WindowElapsed()), (1001, taken(reward=1.0))])
    assert played[0] == (Ignored("no window was due"),)
    assert played[1] == (Execute(0, agent),)
    (done, announced) = played[2]
    assert announced == Announce()
    assert isinstance(done, StepDone)
    assert (done.measures.answers, done.measures.label, done.measures.learned.h) == ((), None, 0.0)
    assert done.measures.values == row(agent, 0.1)


def test_two_teachers_who_name_different_actions_are_silence_but_their_labels_were_applied() -> None:
    session = asked(teachers=("ann", "bob"))
    agent = session.action
    played = play(
        session,
        [
            (1, label("bob", agent, number=1)),
            (2, label("ann", (agent + 1) % 4, number=2)),
            (3, taken(reward=1.0)),
        ],
    )
    assert played[:2] == [
        (Acknowledge(answer_id(1), AnswerCode.ACCEPTED),),
        (Acknowledge(answer_id(2), AnswerCode.ACCEPTED), Execute(0, agent)),
    ]
    done = played[2][0]
    assert isinstance(done, StepDone)
    assert [teacher for teacher, _ in done.measures.answers] == ["ann", "bob"]
    assert (done.measures.label, done.measures.learned.h) == (None, 0.0)
    assert (session.counts.submitted, session.counts.applied) == (2, 2)


def test_a_label_for_another_action_is_blame_and_the_agent_keeps_its_choice() -> None:
    session = asked()
    agent = session.action
    played = play(session, [(1, label("ann", (agent + 1) % 4)), (2, taken())])
    assert played[0] == (Acknowledge(answer_id(0), AnswerCode.ACCEPTED), Execute(0, agent))
    assert session.learner.values(STATES[0]) == row(agent, -0.1)


def test_an_abstention_closes_the_window_and_teaches_nothing() -> None:
    session = asked()
    agent = session.action
    played = play(session, [(1, abstention("ann")), (2, taken())])
    assert played[0] == (Acknowledge(answer_id(0), AnswerCode.ACCEPTED), Execute(0, agent))
    done = played[1][0]
    assert isinstance(done, StepDone)
    assert (done.measures.learned.h, done.measures.label) == (0.0, None)
    assert done.measures.answers == (("ann", Answer(AnswerKind.ABSTAIN)),)
    assert session.counts.submitted == session.counts.applied == 0


@pytest.mark.parametrize(
    "outcome, target",
    [
        pytest.param(Outcome.CAP, 1.0 + 0.9 * 5.0, id="a capped episode is cut off and bootstraps"),
        pytest.param(Outcome.RUNNING, 1.0 + 0.9 * 5.0, id="a running episode bootstraps"),
        pytest.param(Outcome.SOLVED, 1.0, id="a solved state has no future"),
        pytest.param(Outcome.DEADLOCK, 1.0, id="a deadlock has no future"),
    ],
)
def test_the_outcome_decides_whether_the_next_state_counts(outcome: Outcome, target: float) -> None:
    session = asked()
    learn_once(session, STATES[1], 2, 5.0)
    play(session, [(0, WindowElapsed()), (1000, WindowElapsed()), (1001, taken(reward=1.0, outcome=outcome))])
    assert max(session.learner.values(STATES[0])) == 0.1 * target


def learn_once(session: Session, state: bytes, action: int, value: float) -> None:
    """Let the learner value an action, by one terminal step of its own."""
    parts = session.learner
    parts.learn(state, action, value / 0.1, SILENCE, b"end", terminal=True, step=0)


def test_the_next_episode_begins_when_one_ends_and_the_decision_runs_on() -> None:
    session = asked()
    played = play(
        session,
        [(1, label("ann", session.action)), (2, taken(outcome=Outcome.CAP)), (3, began(0)), (4, began(1))],
    )
    assert [type(effect) for effect in played[1]] == [StepDone, EpisodeDone, BeginEpisode]
    assert played[2:] == [(Ignored("no episode was to begin"),), (Announce(),)]
    assert (session.phase, session.decision, session.episode, session.step) == (Phase.ASKING, 1, 1, 0)


def test_a_step_of_another_decision_is_ignored() -> None:
    session = in_phase(Phase.EXECUTING, "sfid")
    assert play(session, [(1, taken(decision=1)), (2, taken(decision=0)), (3, taken(decision=0))])[::2] == [
        (Ignored("no such step was to be taken"),),
        (Ignored("no such step was to be taken"),),
    ]


def test_when_the_last_missing_teacher_leaves_the_window_closes() -> None:
    session = asked(teachers=("ann", "bob"))
    agent = session.action
    assert play(session, [(1, label("ann", agent)), (2, TeacherLeft("bob"))]) == [
        (Acknowledge(answer_id(0), AnswerCode.ACCEPTED),),
        (Announce(), Execute(0, agent)),
    ]


def test_the_answer_of_a_teacher_who_left_still_counts() -> None:
    session = asked(teachers=("ann", "bob"))
    agent = session.action
    played = play(
        session, [(1, label("ann", agent)), (2, TeacherLeft("ann")), (3, abstention("bob")), (4, taken())]
    )
    done = played[3][0]
    assert isinstance(done, StepDone)
    assert (done.measures.label, done.measures.learned.h) == (agent, 1.0)


def test_when_everyone_left_the_window_runs_out_and_the_agent_goes_on_alone() -> None:
    session = asked()
    agent = session.action
    assert play(session, [(1, TeacherLeft("ann")), (1000, WindowElapsed())]) == [
        (Announce(),),
        (Execute(0, agent),),
    ]


def test_stopping_ends_the_session_once_and_gives_up_answers_that_were_not_learnt() -> None:
    session = asked(teachers=("ann", "bob"))
    play(session, [(1, label("ann", 0))])
    assert play(session, [(2, Stopped("ann")), (3, Stopped("ann")), (4, WindowElapsed())]) == [
        (Announce(), SessionDone()),
        (Ignored("already finished"),),
        (Ignored("no window was due"),),
    ]
    counts = session.counts
    assert (counts.submitted, counts.superseded, counts.pending, counts.applied) == (1, 1, 0, 0)


def test_an_answer_whose_step_is_never_learnt_is_not_counted_as_applied() -> None:
    session = asked()
    play(session, [(1, label("ann", 0)), (2, Stopped("ann"))])
    assert (session.counts.applied, session.counts.superseded, session.counts.pending) == (0, 1, 0)
    assert len(session.learner) == 0


@pytest.mark.parametrize(
    "phase, effects",
    [
        (Phase.GATHERING, (Announce(),)),
        (Phase.BEGINNING, (Announce(), BeginEpisode(0))),
        (Phase.READY, (Announce(),)),
        (Phase.ASKING, (Announce(),)),
        (Phase.FINISHED, (Announce(),)),
    ],
)
def test_a_restart_takes_the_session_up_where_it_stood(phase: Phase, effects: tuple[object, ...]) -> None:
    session = in_phase(phase, "sfid")
    assert play(session, [(50, Restarted(2))]) == [effects]
    assert (session.phase, session.epoch) == (phase, 2)


def test_a_restart_while_executing_asks_for_the_same_step_again() -> None:
    session = in_phase(Phase.EXECUTING, "sfid")
    assert play(session, [(50, Restarted(2))]) == [(Announce(), Execute(0, session.action))]


def test_a_restart_while_asking_keeps_the_answers_and_opens_the_window_for_its_whole_span() -> None:
    session = asked(teachers=("ann", "bob"))
    agent = session.action
    assert (
        play(
            session,
            [
                (900, label("ann", agent)),
                (5, Restarted(2)),  # another process: its clock may stand anywhere
                (1004, WindowElapsed()),
                (1005, WindowElapsed()),
            ],
        )[1:]
        == [(Announce(),), (Ignored("no window was due"),), (Execute(0, agent),)]
    )
    assert [given.answer.action for given in session.answers.values()] == [agent]


def test_a_clock_that_stands_behind_takes_no_teaching_time_away() -> None:
    session = asked()
    play(session, [(100, label("ann", 0)), (200, taken(outcome=Outcome.SOLVED)), (500, began(1))])
    play(session, [(450, label("ann", 0, decision=1)), (460, taken(1))])
    assert (session.decision, session.teaching_ns) == (2, 200_000_000)


def test_down_time_is_no_teaching_time() -> None:
    session = asked()
    play(session, [(5000, Restarted(2)), (5100, label("ann", 0)), (5200, taken())])
    assert session.teaching_ns == 200_000_000


def test_a_full_window_is_waited_out_whoever_answered() -> None:
    session = asked(window=FULL)
    agent = session.action
    assert play(session, [(1, label("ann", agent)), (1000, WindowElapsed())]) == [
        (Acknowledge(answer_id(0), AnswerCode.ACCEPTED),),
        (Execute(0, agent),),
    ]
