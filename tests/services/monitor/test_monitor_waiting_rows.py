"""Rows that wait for viewers: the oldest give way, the end of a recording never."""

import threading

import numpy as np
import pytest

from services.monitor.rows import (
    Arrow,
    Curves,
    Document,
    Events,
    Indexed,
    Lane,
    Moment,
    Picture,
    Reliabilities,
    Row,
)
from services.monitor.waiting_rows import MOMENT_BYTES, ROW_BYTES, WaitingRows, size_of


def row(number: int) -> Row:
    return Document("now", Moment(number), f"step {number}")


def picture(number: int, high: int = 100) -> Picture:
    indexed = Indexed(np.zeros((high, 100), np.uint8), np.zeros((256, 3), np.uint8))
    return Picture("world", Moment(number), indexed)


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


def test_large_pictures_give_way_long_before_there_are_many_of_them() -> None:
    waiting = WaitingRows(rows_max=1024, bytes_max=3 * size_of(picture(0)))
    waiting.put("a", *(picture(number) for number in range(9)))
    waiting.put("a", None)
    waiting.close()
    taken = [waiting.take() for _ in range(5)]
    moments = [item[1].moment.step for item in taken if item is not None and isinstance(item[1], Picture)]
    assert (moments, taken[3:], waiting.dropped) == ([6, 7, 8], [("a", None), None], 6)


def test_a_picture_larger_than_the_queue_waits_alone_and_what_is_taken_makes_room() -> None:
    waiting = WaitingRows(bytes_max=2 * size_of(picture(0)))
    taken = []
    waiting.put("a", picture(1), picture(2, high=1_000))
    taken.append(waiting.take())
    for number in range(3, 9):  # each is taken at once: nothing gives way
        waiting.put("a", picture(number))
        taken.append(waiting.take())
    waiting.close()
    assert waiting.take() is None
    moments = [item[1].moment.step for item in taken if item is not None and isinstance(item[1], Picture)]
    assert (moments, waiting.dropped) == ([2, 3, 4, 5, 6, 7, 8], 1)


AT = (Moment(1), Moment(2))


@pytest.mark.parametrize(
    "row, more",
    [
        (picture(1), 10_000),
        (Picture("world", Moment(1), b"x" * 700, (Arrow((0, 0), (1, 1), (0, 0, 0)),)), 700 + MOMENT_BYTES),
        (Picture("world", Moment(1), b"", (), (Lane("ada", AT[:1], ("UP",)),) * 3), 3 * MOMENT_BYTES),
        (Document("now", Moment(1), "x" * 900), 900),
        (Curves("c", AT, np.zeros((2, 3))), 48 + 2 * MOMENT_BYTES),
        (Events(AT, ("abc", "de"), ("INFO", "INFO")), 5 + 2 * MOMENT_BYTES),
        (Lane("ada", AT, ("UP", "")), 2 * MOMENT_BYTES),
        (Reliabilities("ada", "ada", (0, 0, 0), AT, (0.1, 0.2), (0.0, 0.0)), 2 * MOMENT_BYTES),
    ],
)
def test_a_row_weighs_what_it_holds(row: Row, more: int) -> None:
    assert size_of(row) == ROW_BYTES + more
