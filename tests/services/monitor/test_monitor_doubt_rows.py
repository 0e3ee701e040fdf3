"""Pictures and words about doubtful states: written as they change, and again for who comes later."""

import msgspec

from protocol.messages import SaidBy, Step
from services.monitor.chronicle import Chronicle
from services.monitor.doubt_pictures import AGAIN_MS, CONFLICTS, LIST, STATES, DoubtRows
from services.monitor.doubts import Doubts
from services.monitor.rows import Document, Moment
from services.monitor.sampling import DOUBTS_MS, MS
from tests.services.monitor.feeder import WALL_NS, Lesson
from tests.services.monitor.test_monitor_teachers import told

VIEW = "#####\n#@$.#\n#####"


def taught(doubts: Doubts, *labels: tuple[str, str], state: bytes = b"a", cell: int = 6) -> None:
    doubts.add(told(*labels, view=VIEW, state=state, action="DOWN"), cell)


def test_only_what_has_changed_is_written() -> None:
    doubts, rows = Doubts(), DoubtRows()

    def changed(at_ms: int) -> list[str]:
        return [row.entity for row in rows.changed(doubts, VIEW, Moment(at_ms), at_ms * MS)]

    taught(doubts, ("ada", "UP"), state=b"fine")
    assert changed(0) == [CONFLICTS, LIST], "nothing is doubtful yet"
    assert changed(1) == []
    taught(doubts, ("ada", "UP"), ("ben", "LEFT"))
    assert changed(2) == [CONFLICTS, STATES, LIST]
    assert changed(3) == []
    taught(doubts, ("ada", "UP"), state=b"other", cell=7)
    assert changed(4) == [CONFLICTS], "the states are as they were, the floor is not"
    taught(doubts, ("ada", "UP"), ("ben", "LEFT"))
    assert changed(5) == [STATES, LIST], "counts below the states have grown"
    taught(doubts, ("cyd", "UP"), ("ben", "LEFT"), state=b"a")
    assert STATES in changed(6)


def test_what_stays_the_same_is_written_again_for_those_who_come_later() -> None:
    doubts, rows = Doubts(), DoubtRows()
    taught(doubts, ("ada", "UP"), ("ben", "LEFT"))
    times = range(0, 3 * AGAIN_MS, DOUBTS_MS)
    written = [
        (at_ms, row.entity) for at_ms in times for row in rows.changed(doubts, VIEW, Moment(1), at_ms * MS)
    ]
    assert written == [(at, name) for at in (0, AGAIN_MS, 2 * AGAIN_MS) for name in (CONFLICTS, STATES, LIST)]


def test_a_view_that_cannot_be_drawn_writes_nothing() -> None:
    assert DoubtRows().changed(Doubts(), "#####\n#   #\n#####", Moment(1), 0) == []


def test_a_long_lesson_on_which_teachers_agree_again_writes_its_doubts_rarely() -> None:
    """Labelled visits go on every second; after the first nothing about the states changes."""
    chronicle = Chronicle()
    step = next(each for each in Lesson(episodes=1).messages() if isinstance(each, Step))
    differ = tuple(
        SaidBy(teacher=name, kind="label", action=act) for name, act in (("a", "UP"), ("b", "LEFT"))
    )
    for number in range(120):
        at_ns = WALL_NS + number * 1000 * MS
        said, state = (differ, b"s") if number == 0 else (differ[:1], b"t")
        chronicle.tell(
            msgspec.structs.replace(
                step, said=said, state=state, decision=number, at_ns=at_ns, action="DOWN", label=None
            )
        )
    rows = chronicle.take()
    pictures = [row for row in rows.scene if row.entity == STATES]
    texts = [row for row in rows.curves if isinstance(row, Document) and row.entity == LIST]
    assert (len(pictures), len(texts)) == (4, 4)
