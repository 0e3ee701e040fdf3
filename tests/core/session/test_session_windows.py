"""When windows close: modes, quorum, pauses and changes, on a clock of whole milliseconds."""

import pytest

from sfid_core.learning.parameters import ParameterError
from sfid_core.session.config import SessionConfig, Window, WindowMode, WorldSpec
from sfid_core.session.effects import Acknowledge, Announce, AnswerCode, Execute, Ignored
from sfid_core.session.events import (
    Event,
    Paused,
    Resumed,
    TeacherJoined,
    WindowChanged,
    WindowElapsed,
)
from sfid_core.session.state import Phase, Session, new_session
from tests.core.session.script import (
    EARLY,
    FULL,
    MS,
    PATIENT,
    answer_id,
    asked,
    began,
    configured,
    label,
    play,
    praise,
    taken,
)

ACCEPTED = Acknowledge(answer_id(0), AnswerCode.ACCEPTED)


def deadline_ms(session: Session) -> float | None:
    return None if session.deadline_ns is None else session.deadline_ns / MS


@pytest.mark.parametrize(
    "window, closes_at",
    [
        pytest.param(Window(WindowMode.EARLY, 1000, quorum=0), 2, id="early: when everyone has answered"),
        pytest.param(Window(WindowMode.EARLY, 1000, quorum=1), 1, id="early: at the quorum"),
        pytest.param(Window(WindowMode.EARLY, 1000, quorum=3), 3, id="early: at the deadline"),
        pytest.param(Window(WindowMode.FULL, 1000, quorum=1), 3, id="full: at the deadline"),
        pytest.param(Window(WindowMode.UNTIL_ANSWERED, 1000, 0), 2, id="until answered: by everyone"),
        pytest.param(Window(WindowMode.UNTIL_ANSWERED, 1000, 1), 1, id="until answered: by the quorum"),
        pytest.param(Window(WindowMode.UNTIL_ANSWERED, 1000, 3), None, id="until answered: not yet"),
    ],
)
def test_the_mode_and_the_quorum_decide_which_event_closes_the_window(
    window: Window, closes_at: int | None
) -> None:
    session = asked(window=window, teachers=("ann", "bob"))
    events: list[tuple[int, Event]] = [
        (1, label("ann", 0)),
        (2, label("bob", 0)),
        (1000, WindowElapsed()),
    ]
    closed = [
        number
        for number, effects in enumerate(play(session, events), start=1)
        if any(isinstance(effect, Execute) for effect in effects)
    ]
    assert closed == ([] if closes_at is None else [closes_at])


def test_a_window_until_answered_wants_no_timer() -> None:
    session = asked(window=PATIENT)
    assert session.deadline_ns is None
    assert play(session, [(10_000_000, WindowElapsed())]) == [(Ignored("no window was due"),)]


def test_a_pause_keeps_the_remaining_time() -> None:
    session = asked()
    assert deadline_ms(session) == 1000
    assert play(session, [(400, Paused("ann"))]) == [(Announce(),)]
    assert deadline_ms(session) is None
    assert play(session, [(5000, WindowElapsed()), (5000, Paused("ann")), (9000, Resumed("ann"))]) == [
        (Ignored("no window was due"),),
        (Ignored("already paused or finished"),),
        (Announce(),),
    ]
    assert deadline_ms(session) == 9600


def test_a_second_pause_keeps_what_the_first_left() -> None:
    session = asked()
    play(session, [(400, Paused("ann")), (500, Resumed("ann")), (700, Paused("ann")), (2000, Resumed("ann"))])
    assert deadline_ms(session) == 2400


def test_a_resumption_without_a_pause_is_ignored() -> None:
    session = asked()
    assert play(session, [(1, Resumed("ann"))]) == [(Ignored("not paused"),)]
    assert deadline_ms(session) == 1000


def test_time_in_a_pause_is_no_teaching_time() -> None:
    session = asked()
    play(session, [(100, Paused("ann")), (9100, Resumed("ann")), (9200, label("ann", 0)), (9300, taken())])
    assert session.teaching_ns == 300 * MS


def test_a_pause_between_decisions_holds_the_next_one_back() -> None:
    session = asked()
    play(session, [(1, label("ann", 0)), (2, Paused("ann")), (3, taken())])
    assert session.phase is Phase.READY
    assert play(session, [(9000, Resumed("ann"))]) == [(Announce(),)]
    assert (session.phase, session.decision, deadline_ms(session)) == (Phase.ASKING, 1, 10_000)


def test_a_pause_before_the_episode_holds_its_first_decision_back() -> None:
    session = new_session(configured("q-learning"))
    play(session, [(0, TeacherJoined("ann")), (1, Paused("ann"))])
    assert play(session, [(2, began()), (3, Resumed("ann"))]) == [
        (Announce(),),
        (Announce(), Execute(0, session.action)),
    ]


def test_a_reward_window_that_opens_in_a_pause_starts_to_run_at_the_resumption() -> None:
    session = asked("reward")
    play(session, [(1, Paused("ann")), (2, taken())])
    assert (session.phase, deadline_ms(session)) == (Phase.ASKING, None)
    play(session, [(500, Resumed("ann"))])
    assert deadline_ms(session) == 1500


def test_a_longer_window_is_measured_from_the_opening_of_the_decision() -> None:
    session = asked()
    window = Window(WindowMode.EARLY, 3000)
    assert play(session, [(600, WindowChanged("ann", window))]) == [(Announce(),)]
    assert deadline_ms(session) == 3000
    assert session.window == window


def test_a_window_made_shorter_than_what_has_passed_is_due_at_once() -> None:
    session = asked()
    agent = session.action
    assert play(
        session, [(600, WindowChanged("ann", Window(WindowMode.EARLY, 500))), (600, WindowElapsed())]
    ) == [
        (Announce(),),
        (Execute(0, agent),),
    ]


def test_a_pause_is_no_part_of_the_window_when_it_changes_later() -> None:
    session = asked()
    play(session, [(400, Paused("ann")), (9400, Resumed("ann"))])
    play(session, [(9500, WindowChanged("ann", Window(WindowMode.EARLY, 2000)))])
    assert deadline_ms(session) == 9500 + 2000 - 500


def test_a_window_changed_in_a_pause_keeps_the_time_that_had_passed() -> None:
    session = asked()
    play(session, [(400, Paused("ann")), (500, WindowChanged("ann", Window(WindowMode.EARLY, 3000)))])
    assert deadline_ms(session) is None
    play(session, [(9000, Resumed("ann"))])
    assert deadline_ms(session) == 9000 + 3000 - 400


def test_a_patient_window_that_becomes_an_early_one_counts_from_its_opening() -> None:
    session = asked(window=PATIENT)
    play(session, [(300, WindowChanged("ann", EARLY))])
    assert deadline_ms(session) == 1000


def test_a_window_without_an_end_that_is_given_one_has_its_whole_span_from_then_on() -> None:
    session = asked(window=PATIENT)
    play(session, [(60_000, WindowChanged("ann", EARLY, afresh=True))])
    assert deadline_ms(session) == 61_000
    play(session, [(60_400, WindowChanged("ann", Window(WindowMode.FULL, 3000)))])
    assert deadline_ms(session) == 63_000
    play(session, [(60_500, Paused("ann")), (90_000, Resumed("ann"))])
    assert deadline_ms(session) == 92_500
    play(session, [(92_500, WindowElapsed()), (92_510, taken())])
    assert deadline_ms(session) == 92_510 + 3000


def test_a_window_without_an_end_that_is_given_one_in_a_pause_has_its_whole_span_after_it() -> None:
    session = asked(window=PATIENT)
    play(session, [(700, Paused("ann")), (800, WindowChanged("ann", EARLY, afresh=True))])
    play(session, [(5000, Resumed("ann"))])
    assert deadline_ms(session) == 6000


def test_a_full_window_that_becomes_an_early_one_closes_when_everyone_has_answered() -> None:
    session = asked(window=FULL)
    agent = session.action
    assert play(session, [(1, label("ann", 0)), (2, WindowChanged("ann", EARLY))]) == [
        (ACCEPTED,),
        (Announce(), Execute(0, agent)),
    ]


def test_a_window_changed_between_windows_is_used_from_the_next_one_on() -> None:
    session = asked()
    play(session, [(1, label("ann", 0)), (2, WindowChanged("ann", Window(WindowMode.FULL, 50)))])
    play(session, [(3, taken())])
    assert deadline_ms(session) == 53


def test_a_teacher_who_joins_is_waited_for() -> None:
    session = asked()
    agent = session.action
    assert play(session, [(1, TeacherJoined("bob")), (2, label("ann", 0)), (3, label("bob", 0))]) == [
        (Announce(),),
        (ACCEPTED,),
        (ACCEPTED, Execute(0, agent)),
    ]


def test_the_window_for_rewards_opens_with_the_step_and_closes_with_the_reward() -> None:
    session = asked("reward")
    assert (session.phase, deadline_ms(session)) == (Phase.EXECUTING, None)
    play(session, [(100, taken())])
    assert (session.phase, deadline_ms(session)) == (Phase.ASKING, 1100)
    play(session, [(200, praise("ann", 1.0))])
    assert (session.phase, session.decision) == (Phase.EXECUTING, 1)


@pytest.mark.parametrize("span_ms, quorum", [(0, 0), (-1, 0), (3_600_001, 0), (1000, -1)])
def test_a_window_outside_its_ranges_is_refused_in_one_line(span_ms: int, quorum: int) -> None:
    with pytest.raises(ParameterError, match=r"^window [^\n]+$"):
        Window(WindowMode.EARLY, span_ms, quorum)


@pytest.mark.parametrize("episodes, teachers_min", [(0, 1), (1_000_001, 1), (30, -1)])
def test_a_session_outside_its_ranges_is_refused_in_one_line(episodes: int, teachers_min: int) -> None:
    with pytest.raises(ParameterError, match=r"^(episodes|teachers_min) [^\n]+$"):
        SessionConfig("lab", WorldSpec(""), episodes=episodes, teachers_min=teachers_min)


def test_an_unknown_method_is_refused_with_the_ones_there_are() -> None:
    with pytest.raises(
        ParameterError, match=r"unknown method 'magic': choose one of [^\n]*sfid[^\n]*q-learning"
    ):
        new_session(configured("magic"))
