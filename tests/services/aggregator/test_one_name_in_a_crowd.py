"""Two of one name in a crowd at once would take each other's answers back: the second one is told."""

from protocol.messages import WindowSpec
from services.client import Opened, Refused, Welcomed
from tests.services.aggregator.crowd_room import CrowdRoom
from tests.services.learner.classroom import session
from tests.services.learner.program import Program, kinds

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
