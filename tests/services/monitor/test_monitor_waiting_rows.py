"""Rows that wait for viewers: the oldest give way, the end of a recording never."""

import threading

from services.monitor.rows import Document, Moment, Row
from services.monitor.waiting_rows import WaitingRows


def row(number: int) -> Row:
    return Document("now", Moment(number), f"step {number}")


def test_the_oldest_rows_give_way_and_are_counted() -> None:
    waiting = WaitingRows(rows_max=2)
    waiting.put("a", row(1), row(2), row(3))
    waiting.close()
    assert [waiting.take() for _ in range(3)] == [("a", row(2)), ("a", row(3)), None]
    assert waiting.dropped == 1


def test_the_end_of_a_recording_never_gives_way() -> None:
    waiting = WaitingRows(rows_max=2)
    waiting.put("a", None)
    waiting.put("b", row(1), row(2), None)
    waiting.put("c", row(3), None)
    waiting.close()
    taken = []
    while (item := waiting.take()) is not None:
        taken.append(item)
    assert [recording for recording, end in taken if end is None] == ["a", "b", "c"]


def test_who_takes_waits_for_a_row_and_ends_with_the_queue() -> None:
    waiting, taken = WaitingRows(), []

    def take() -> None:
        while (item := waiting.take()) is not None:
            taken.append(item)

    thread = threading.Thread(target=take, daemon=True)
    thread.start()
    waiting.put("a", row(1))
    waiting.close()
    thread.join(10)
    assert (taken, thread.is_alive()) == ([("a", row(1))], False)
