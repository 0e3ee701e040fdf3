"""What the monitor says about teachers and sessions: doubts, reliability, and all sessions at a glance."""

import msgspec
import numpy as np

from protocol.crowd_message import Crowd, WorkerReliability
from protocol.messages import Decision, Episode, SaidBy, Step
from services import tiles
from services.monitor.chronicle import Chronicle
from services.monitor.doubt_pictures import draw_doubtful
from services.monitor.doubts import Doubts
from services.monitor.overview import draw_overview, glance
from services.monitor.reliability import Reliability
from services.monitor.rows import Arrow, Document, Indexed, Moment
from services.monitor.scene import TEACHER_COLOURS, TeacherColours, read_view
from services.monitor.session_view import SessionView
from services.monitor.status import NOW, OF_TWO
from services.tiles import Indexes
from tests.services.monitor.feeder import WALL_NS, Lesson
from tests.services.monitor.test_monitor_pictures import indexes_of

SECOND_NS = 10**9


def told(*labels: tuple[str, str], at_s: int = 0, state: bytes = b"s", **changes: object) -> Step:
    step = next(each for each in Lesson(episodes=1).messages() if isinstance(each, Step))
    said = tuple(SaidBy(teacher=name, kind="label", action=action) for name, action in labels)
    label = labels[0][1] if labels else None
    return msgspec.structs.replace(
        step, said=said, label=label, at_ns=WALL_NS + at_s * SECOND_NS, state=state, **changes
    )


def test_a_state_is_doubtful_by_what_cannot_all_be_right() -> None:
    doubts = Doubts()
    assert not doubts.add(told(), 7)
    doubts.add(told(("ada", "UP"), ("ben", "UP"), action="DOWN"), 7)
    doubts.add(told(("ada", "UP"), ("ben", "LEFT"), action="DOWN"), 7)
    blocked = told(("ada", "DOWN"), action="DOWN")
    doubts.add(msgspec.structs.replace(blocked, next_view=blocked.view), 7)
    doubts.add(told(("ada", "UP"), state=b"fine", action="DOWN"), 9)
    (state,) = doubts.worst()
    assert (state.visits, state.split, state.turned, state.blocked, state.fatal) == (3, 1, 2, 1, 0)
    assert state.reasons() == (
        "teachers differed on 1 of 3 visits; a teacher changed their mind 2 times; "
        "the named move moved nothing once"
    )
    assert doubts.cells() == {7: (3, 1), 9: (1, 0)}


def test_a_move_that_was_named_and_made_and_ended_the_episode_unsolved_is_doubtful() -> None:
    doubts = Doubts()
    for outcome, action in (("deadlock", "UP"), ("failed", "UP"), ("failed", "DOWN"), ("cap", "UP")):
        doubts.add(told(("ada", "UP"), action=action, outcome=outcome, next_view="gone"), 7)
    (state,) = doubts.worst()
    assert (state.fatal, state.score) == (2, 2)
    assert state.reasons() == "the named move ended it unsolved 2 times"


def test_doubtful_states_are_numbered_and_say_below_how_often_each_move_was_named() -> None:
    def pictured(*labels: tuple[str, str]) -> tuple[Indexes, tuple[Arrow, ...]]:
        doubts = Doubts()
        doubts.add(told(*labels, action="DOWN"), 7)
        picture = draw_doubtful(doubts.worst(), Moment(1))
        assert picture is not None
        return indexes_of(picture), picture.arrows

    two, arrows = pictured(("ada", "UP"), ("ben", "LEFT"))
    three, _ = pictured(("ada", "UP"), ("ben", "LEFT"), ("cyd", "UP"))
    board = read_view(told().view).level
    below = board.height * tiles.TILE
    assert np.array_equal(two[:below], three[:below]), "nothing is written over the board"
    assert two[below:].any()
    assert not np.array_equal(two[below:], three[below:])
    assert [arrow.vector for arrow in arrows] == [(-12.0, 0.0), (0.0, -12.0)]


def test_the_state_labelled_longest_ago_is_forgotten_first() -> None:
    doubts = Doubts(states_max=2)
    for name in (b"a", b"b", b"a", b"c"):
        doubts.add(told(("ada", "UP"), ("ben", "DOWN"), state=name), 1)
    assert sorted(state.visits for state in doubts.worst()) == [1, 2]


def test_who_errs_against_two_who_agree_is_found_less_reliable_and_one_alone_is_not_rated() -> None:
    reliability = Reliability(TeacherColours())
    for number in range(60):
        wrong = "LEFT" if number % 2 else "UP"
        labels = (("ada", "UP"), ("ben", "UP"), ("cyd", wrong))
        reliability.add(told(*labels, at_s=number), Moment(number))
    reliability.add(told(("dan", "UP"), at_s=100), Moment(100))
    curves = {row.teacher: row for row in reliability.take()}
    assert set(curves) == {"ada", "ben", "cyd"}
    assert all(len(row.moments) == 60 for row in curves.values())
    assert curves["cyd"].means[-1] + 2 * curves["cyd"].errors[-1] < curves["ada"].means[-1]
    assert curves["ada"].errors[-1] < curves["ada"].errors[0]


def test_the_legend_says_of_two_that_nothing_tells_who_of_them_errs_until_there_is_a_third() -> None:
    colours = TeacherColours()
    assert colours.of("ben") == TEACHER_COLOURS[0]
    reliability = Reliability(colours)
    reliability.add(told(("ada", "UP"), ("ben", "LEFT"), at_s=0), Moment(0))
    reliability.add(told(("ada", "UP"), ("ben", "UP"), at_s=2), Moment(1))
    ada, ben = reliability.take()
    assert (ada.label, ben.label) == tuple(
        f"{name} (of two: which one errs is unknown)" for name in ("ada", "ben")
    )
    assert (ada.means, ada.errors) == (ben.means, ben.errors)
    assert (ben.colour, ada.colour) == TEACHER_COLOURS[:2]
    reliability.add(told(("ada", "UP"), ("ben", "UP"), ("cyd", "DOWN"), at_s=4), Moment(2))
    assert [row.label for row in reliability.take()] == ["ada", "ben", "cyd"]


def test_how_things_stand_says_of_two_that_nothing_tells_who_of_them_errs_only_while_it_is_so() -> None:
    def texts(view: SessionView, number: int, *labels: tuple[str, str]) -> list[str]:
        view.take(msgspec.structs.replace(opened, sequence=opened.sequence + number), float(number))
        view.take(told(*labels, at_s=number, decision=number), float(number))
        rows = view.tick(number + 0.5)
        return [
            row.markdown for part in (rows.live, rows.kept) for row in part.curves
            if isinstance(row, Document) and row.entity == NOW
        ]  # fmt: skip

    opened = next(each for each in Lesson(episodes=1).messages() if isinstance(each, Decision))
    view = SessionView(0.0)
    assert not any(OF_TWO in text for text in texts(view, 1, ("ada", "UP")))
    of_two = texts(view, 3, ("ada", "UP"), ("ben", "LEFT"))
    assert of_two
    assert all(OF_TWO in text for text in of_two)
    third = texts(view, 5, ("ada", "UP"), ("ben", "UP"), ("cyd", "UP"))
    assert third
    assert not any(OF_TWO in text for text in third)


def test_what_is_told_of_a_step_is_the_same_whether_an_aggregator_reports_or_not() -> None:
    crowd = Crowd(
        session="s", aggregator="crowd", epoch=1, decision=0, at_ns=WALL_NS, cause="quorum",
        members=1, answered=1, conclusions=1, too_late=0, workers=(),
    )  # fmt: skip

    def now(*messages: Step | Crowd) -> list[Document]:
        chronicle = Chronicle()
        for message in messages:
            chronicle.tell(message)
        return [row for row in chronicle.take().curves if isinstance(row, Document) and row.entity == NOW]

    first = told(("ada", "UP"), ("ben", "LEFT"))
    second = told(("ada", "UP"), ("ben", "UP"), at_s=2, decision=1)
    assert [OF_TWO in row.markdown for row in now(first, second)] == [True, True]
    assert now(first, crowd, second) == now(first, second)


def test_an_aggregators_report_is_shown_as_it_is_once_a_second_at_most() -> None:
    reliability = Reliability(TeacherColours())
    worker = WorkerReliability(
        worker="ada", mean=0.75, standard_error=0.125, labels=9, standing="good", present=True
    )
    for number in range(4):
        at_ns = WALL_NS + number * SECOND_NS // 2
        crowd = Crowd(
            session="s", aggregator="crowd", epoch=1, decision=number, at_ns=at_ns,
            cause="quorum", members=1, answered=1, conclusions=number, too_late=0, workers=(worker,),
        )  # fmt: skip
        reliability.add_crowd(crowd, Moment(number))
    (row,) = reliability.take()
    assert (row.moments, row.means, row.errors) == ((Moment(0), Moment(2)), (0.75, 0.75), (0.125, 0.125))
    assert row.label == "ada"


def view_of(**changes: object) -> SessionView:
    view = SessionView(0.0)
    for message in Lesson(episodes=2).messages():
        if not isinstance(message, Decision) or message.phase != "finished":
            view.take(message, 10.0)
    assert view.decision is not None
    view.take(msgspec.structs.replace(view.decision, sequence=view.decision.sequence + 1, **changes), 10.0)
    return view


def test_a_session_that_waits_is_told_apart_from_one_that_goes_on() -> None:
    def state(now_s: float, **changes: object) -> tuple[str, bool]:
        card = glance("s", view_of(**changes), now_s)
        return card.state, card.stuck

    assert state(11.0, phase="asking") == ("teaching", False)
    assert state(200.0, phase="asking") == ("no step for 3 min", True)
    assert state(40.0, phase="executing") == ("silent for 30 s", True)
    assert state(999.0, phase="gathering") == ("waiting for teachers", True)
    assert state(999.0, phase="asking", paused=True) == ("paused", False)
    assert state(999.0, phase="finished") == ("finished", False)
    assert state(11.0, phase="asking", teachers=(), teachers_present=0) == ("running alone", False)
    endless = {"phase": "asking", "remaining_ms": None}
    assert state(11.0, **endless, teachers=(), teachers_present=0) == ("nobody to answer", True)
    assert state(11.0, **endless) == ("teaching", False)
    alone = {"phase": "executing", "remaining_ms": None, "teachers": (), "teachers_present": 0}
    assert state(11.0, **alone) == ("running alone", False)


def test_five_unsolved_episodes_are_a_session_to_look_after() -> None:
    view = view_of(phase="asking")
    last = view.recent[-1]
    for number in range(5):
        episode: Episode = msgspec.structs.replace(last, episode=2 + number, outcome="cap")
        view.take(episode, 10.0)
    assert glance("s", view, 11.0).state == "5 episodes unsolved"


def test_all_sessions_are_cards_in_one_picture_who_needs_somebody_first() -> None:
    views = {"fine": view_of(phase="asking"), "stuck": view_of(phase="gathering")}
    cards = [glance(name, view, 11.0) for name, view in views.items()]
    alone = indexes_of(draw_overview(cards[:1], Moment(3)))
    both = indexes_of(draw_overview(cards, Moment(3)))
    crowded = indexes_of(draw_overview(cards, Moment(3), unshown=284))
    assert both.shape[1] > alone.shape[1]
    assert both[alone.shape[0] :].any(), "a line says how to watch another"
    assert np.array_equal(crowded[: both.shape[0]], both)
    assert crowded[both.shape[0] :].any(), "a line says how many are not shown"
    image = draw_overview(cards, Moment(3)).image
    assert isinstance(image, Indexed)
    first = image.palette[both[20, 9]]
    assert np.array_equal(first, (255, 92, 84))
