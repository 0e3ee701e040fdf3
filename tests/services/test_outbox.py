import sqlite3
from pathlib import Path

import pytest

from services.outbox import Outbox, OutboxError


@pytest.mark.parametrize("kept", ["memory", "file"])
def test_answers_wait_in_order_until_they_are_deleted(kept: str, tmp_path: Path) -> None:
    with Outbox(tmp_path / "deep" / "box.sqlite" if kept == "file" else None) as outbox:
        for answer_id in (b"c", b"a", b"b"):
            outbox.store(answer_id, b"payload of " + answer_id)
        outbox.delete(b"a")
        outbox.delete(b"never stored")
        assert outbox.pending() == [(b"c", b"payload of c"), (b"b", b"payload of b")]


def test_a_stored_answer_is_there_for_who_opens_the_file_while_the_first_process_still_holds_it(
    tmp_path: Path,
) -> None:
    path = tmp_path / "box.sqlite"
    with Outbox(path) as first:
        first.store(b"a", b"payload")
        with Outbox(path) as second:
            assert second.pending() == [(b"a", b"payload")]


def test_a_file_that_is_no_outbox_is_one_line_with_the_mend(tmp_path: Path) -> None:
    path = tmp_path / "box.sqlite"
    path.write_bytes(b"these are someone's notes" * 100)
    with pytest.raises(OutboxError, match=r"box.sqlite: cannot keep answers there \(.*\); choose a writable"):
        Outbox(path)


def test_an_outbox_that_fails_says_so_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "box.sqlite"
    with Outbox(path) as outbox:
        with sqlite3.connect(path) as other:
            other.execute("DROP TABLE answers")
        other.close()
        with pytest.raises(OutboxError, match=r"no such table: answers; free the disk or choose another"):
            outbox.store(b"a", b"payload")
