"""Two who teach under one name at once: the second one is told, and a teacher who comes again is not."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from protocol.messages import Join, Welcome
from services.client import AnswerState, AnswerUpdate, Opened, Refused, Welcomed
from tests.services.learner.classroom import KEYS, MS, Classroom, Pupil
from tests.services.learner.guarded_room import GuardedRoom
from tests.services.learner.program import Program, is_refused, kinds

TAKEN = "somebody teaches s1 as ann already: choose another --name, or wait until they have left"


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Classroom]:
    made = Classroom(tmp_path / "data")
    made.create()
    yield made
    made.shard.discard_pending()
    made.shard.close()


def test_the_second_of_a_name_is_told_and_not_asked_until_the_first_has_left(room: Classroom) -> None:
    first = Program(room)
    assert kinds(first.watch()) == {Welcomed, Opened}
    second = Program(room)
    told = second.watch(2_000)
    assert {update for update in told if isinstance(update, Refused)} == {
        Refused("conflict", TAKEN, final=False)
    }
    assert kinds(told) == {Refused}
    assert (room.present(), kinds(first.watch(2_000))) == (("ann",), set())
    first.client.close()
    assert kinds(second.watch(2_000)) == {Welcomed, Opened}
    assert room.present() == ("ann",)
    second.client.close()
    room.settle()
    assert room.present() == ()


def test_what_the_second_says_is_kept_until_it_is_let_in(room: Classroom) -> None:
    first = Program(room)
    first.watch()
    second = Program(room)
    second.watch()
    answer_id = second.client.answer(room.decision, action="UP")
    told = second.watch(5_000)
    assert [update.state for update in told if isinstance(update, AnswerUpdate)] == [AnswerState.SENDING]
    assert (second.client.unacknowledged, room.rows("answer")) == (1, [])
    first.client.close()
    told = second.watch(2_000)
    fates = {update.answer_id: update.state for update in told if isinstance(update, AnswerUpdate)}
    assert fates == {answer_id: AnswerState.SAVED}
    assert (second.client.unacknowledged, len(room.rows("answer"))) == (0, 1)


@pytest.mark.parametrize("seen_to_die", [True, False])
def test_a_teacher_who_was_killed_comes_back_whether_or_not_it_was_seen(
    room: Classroom, *, seen_to_die: bool
) -> None:
    killed = Program(room)
    assert kinds(killed.watch()) == {Welcomed, Opened}
    leave: Callable[[], None] = killed.bus.close
    if seen_to_die:
        leave()
        room.settle()
    again = Program(room)
    came = again.watch()
    assert kinds(came) == ({Welcomed, Opened} if seen_to_die else {Refused})
    if not seen_to_die:
        leave()
        assert kinds(again.watch(2_000)) == {Welcomed, Opened}
    assert room.present() == ("ann",)


def test_a_teacher_who_was_cut_off_or_whose_learner_died_is_not_taken_for_another(room: Classroom) -> None:
    ann = Program(room)
    assert kinds(ann.watch()) == {Welcomed, Opened}
    ann.bus.set_online(online=False)
    room.settle()
    ann.bus.set_online(online=True)
    assert Refused not in kinds(ann.watch(2_000))
    assert room.present() == ("ann",)
    room.kill_learner()
    room.start_learner()
    assert Refused not in kinds(ann.watch(2_000))
    assert room.present() == ("ann",)


@pytest.mark.parametrize("restarts", [1, 3])
def test_a_restart_gives_the_place_of_the_first_to_nobody_else(room: Classroom, *, restarts: int) -> None:
    first = Program(room)
    assert kinds(first.watch()) == {Welcomed, Opened}
    second = Program(room)
    assert kinds(second.watch()) == {Refused}
    for _ in range(restarts):
        room.kill_learner()
        room.start_learner()
        told = second.watch(2_000), first.watch(2_000), second.watch(2_000)
        assert [kinds(each) for each in told] == [{Refused}, {Welcomed, Opened}, {Refused}]
    first.client.close()
    assert kinds(second.watch(2_000)) == {Welcomed, Opened}
    assert room.present() == ("ann",)


def test_of_two_who_come_to_a_learner_that_starts_anew_one_teaches(room: Classroom) -> None:
    """The second was started while no learner was there, so that both show a token."""
    first = Program(room)
    assert kinds(first.watch()) == {Welcomed, Opened}
    room.kill_learner()
    second = Program(room)
    room.start_learner()
    waits = {is_refused(program): program for program in (second, first)}
    assert set(waits) == {True, False}
    assert room.present() == ("ann",)
    waits[False].client.close()
    assert kinds(waits[True].watch(2_000)) == {Welcomed, Opened}
    assert room.present() == ("ann",)


def test_whoever_takes_the_place_of_one_who_was_cut_off_keeps_it(room: Classroom) -> None:
    first = Program(room)
    assert kinds(first.watch()) == {Welcomed, Opened}
    second = Program(room)
    assert kinds(second.watch()) == {Refused}
    first.bus.set_online(online=False)
    assert kinds(second.watch(2_000)) == {Welcomed, Opened}
    first.bus.set_online(online=True)
    assert (is_refused(first), is_refused(second)) == (True, False)
    assert room.present() == ("ann",)


def test_who_is_let_in_and_shows_no_token_keeps_the_place_from_nobody(room: Classroom) -> None:
    joined = room.ask(
        room.watcher, KEYS.join("s1", "ann"), Join(session="s1", teacher="ann", client="mine#1")
    )
    assert joined.ok
    waiting = Program(room)
    assert kinds(waiting.watch()) == {Refused}
    room.clock.advance(room.learner.config.teachers_gone_ms * MS)
    assert not is_refused(waiting)


def test_the_token_of_another_run_is_enough_to_be_back_where_the_first_was_given_up(room: Classroom) -> None:
    room.ask(room.watcher, KEYS.join("s1", "ann"), Join(session="s1", teacher="ann", client="mine#1"))
    assert room.present() == ("ann",)
    room.clock.advance(room.learner.config.teachers_gone_ms * MS)
    room.settle()
    assert room.present() == ()
    room.watcher.announce(KEYS.present("s1", "ann", "2"))
    room.settle()
    assert room.present() == ("ann",)


def test_a_program_that_does_not_say_which_run_it_is_is_let_in_as_before(room: Classroom) -> None:
    assert kinds(Program(room).watch()) == {Welcomed, Opened}
    assert isinstance(Pupil(room, "ann").join(client="sfid page"), Welcome)
    assert isinstance(Pupil(room, "ann").join(client="mine#1"), Welcome)
    assert (
        room.refused(KEYS.join("s1", "ann"), Join(session="s1", teacher="ann", client="mine#2")).reason
        == TAKEN
    )


def test_a_program_that_joins_again_is_not_another(room: Classroom) -> None:
    """A welcome may be lost on its way."""
    ann = Pupil(room, "ann")
    assert isinstance(ann.join(client="mine#1"), Welcome)
    assert isinstance(ann.join(client="mine#1"), Welcome)


def test_whoever_has_the_token_is_one_person_at_two_screens(tmp_path: Path) -> None:
    guarded = GuardedRoom(tmp_path / "data")
    guarded.create()
    token = guarded.token("ann")
    assert kinds(Program(guarded, token=token).watch()) == {Welcomed, Opened}
    assert kinds(Program(guarded, token=token).watch()) == {Welcomed, Opened}
    guarded.shard.discard_pending()
    guarded.shard.close()
