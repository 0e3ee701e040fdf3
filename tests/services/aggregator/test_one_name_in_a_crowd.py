"""Two of one name in a crowd at once would take each other's answers back: the second one is told."""

import pytest

from protocol.messages import Join, WindowSpec
from services.client import Opened, Refused, Welcomed
from tests.services.aggregator.crowd_room import CROWD_KEYS, CrowdRoom
from tests.services.learner.classroom import session
from tests.services.learner.program import Program, is_refused, kinds

TAKEN = "somebody teaches s1 as ann already: choose another --name, or wait until they have left"
PATIENT = session(window=WindowSpec(mode="until-answered", span_ms=1_000))


def member(room: CrowdRoom) -> Program:
    return Program(room, "ann", deployment="local-crowd")


def members_of(room: CrowdRoom) -> set[str]:
    assert room.aggregator is not None
    crowd = room.aggregator.crowds["s1"].crowd
    assert crowd is not None
    return set(crowd.members)


def test_the_second_of_a_name_is_told_and_not_asked_until_the_first_has_left(crowd_room: CrowdRoom) -> None:
    crowd_room.create(PATIENT)
    first = member(crowd_room)
    assert kinds(first.watch(500)) == {Welcomed, Opened}
    second = member(crowd_room)
    told = second.watch(2_000)
    assert {update for update in told if isinstance(update, Refused)} == {
        Refused("conflict", TAKEN, final=False)
    }
    assert (kinds(told), members_of(crowd_room)) == ({Refused}, {"ann"})
    first.client.close()
    assert kinds(second.watch(2_000)) == {Welcomed, Opened}
    assert members_of(crowd_room) == {"ann"}


@pytest.mark.parametrize("second_is_first", [True, False])
def test_a_restart_gives_the_place_of_the_first_to_nobody_else(
    crowd_room: CrowdRoom, *, second_is_first: bool
) -> None:
    crowd_room.create(PATIENT)
    first = member(crowd_room)
    assert kinds(first.watch(500)) == {Welcomed, Opened}
    second = member(crowd_room)
    assert kinds(second.watch()) == {Refused}
    for _ in range(3):
        crowd_room.kill_aggregator()
        if second_is_first:  # its join waits for the aggregator
            second.watch(1_000)
        crowd_room.start_aggregator()
        assert (is_refused(second), is_refused(first)) == (True, False)
        assert members_of(crowd_room) == {"ann"}
    first.client.close()
    assert kinds(second.watch(2_000)) == {Welcomed, Opened}
    assert members_of(crowd_room) == {"ann"}


def test_of_two_who_come_to_an_aggregator_that_starts_anew_one_teaches(crowd_room: CrowdRoom) -> None:
    """The second was started while no aggregator was there, so that both show a token."""
    crowd_room.create(PATIENT)
    first = member(crowd_room)
    assert kinds(first.watch(500)) == {Welcomed, Opened}
    crowd_room.kill_aggregator()
    second = member(crowd_room)
    crowd_room.start_aggregator()
    waits = {is_refused(program): program for program in (second, first)}
    assert set(waits) == {True, False}
    waits[False].client.close()
    assert kinds(waits[True].watch(2_000)) == {Welcomed, Opened}
    assert members_of(crowd_room) == {"ann"}


def test_the_token_of_another_run_is_enough_to_be_back_where_the_first_was_given_up(
    crowd_room: CrowdRoom,
) -> None:
    crowd_room.create(PATIENT)
    staying = Program(crowd_room, "bob", deployment="local-crowd")
    staying.watch(500)
    join = Join(session="s1", teacher="ann", client="mine#1")
    assert crowd_room.ask(crowd_room.watcher, CROWD_KEYS.join("s1", "ann"), join).ok
    assert members_of(crowd_room) == {"ann", "bob"}
    staying.watch(20_000)
    assert members_of(crowd_room) == {"bob"}
    crowd_room.watcher.announce(CROWD_KEYS.present("s1", "ann", "2"))
    crowd_room.settle()
    assert members_of(crowd_room) == {"ann", "bob"}


def test_of_two_who_wait_for_the_crowd_to_be_let_in_one_teaches(crowd_room: CrowdRoom) -> None:
    first, second = member(crowd_room), member(crowd_room)
    for program in (first, second):
        assert kinds(program.watch(1_000)) <= {Refused}
    crowd_room.create(PATIENT)
    assert {is_refused(program) for program in (second, first)} == {True, False}


def test_a_member_who_was_cut_off_or_whose_aggregator_died_is_not_taken_for_another(
    crowd_room: CrowdRoom,
) -> None:
    crowd_room.create(PATIENT)
    ann = member(crowd_room)
    assert kinds(ann.watch(500)) == {Welcomed, Opened}
    ann.bus.set_online(online=False)
    crowd_room.settle()
    ann.bus.set_online(online=True)
    assert Refused not in kinds(ann.watch(2_000))
    assert members_of(crowd_room) == {"ann"}
    crowd_room.kill_aggregator()
    crowd_room.start_aggregator()
    assert Refused not in kinds(ann.watch(2_000))
    assert members_of(crowd_room) == {"ann"}
