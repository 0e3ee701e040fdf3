"""A session named after whom it speaks of loses its name too, whatever moment the erasing is killed at."""

import shutil
import signal
from pathlib import Path

from services.runtime.journal import Row, Shard, read_rows, verify
from tests.services.operations.mortal import code_when_killed_at
from tests.services.operations.test_forget import holding

PERSON = "zelda-quux"
LESSON = f"maze-{PERSON}-0"


def journal(data: Path) -> list[Row]:
    """Write a journal with a lesson and another session; return the rows of the other."""
    with Shard.open(data) as shard:
        for number in range(50):
            person = PERSON if number % 2 else "ann"
            shard.append(
                LESSON if number % 2 else "s2", "answer", f"{person} said {number}".encode(), at_ns=number,
                unique=number.to_bytes(16, "big"), person=person,
            )  # fmt: skip
            shard.commit()
    return list(read_rows(data, "s2"))


def erase_lesson(data: Path) -> None:
    """Erase LESSON; also run by processes that are killed on the way."""
    with Shard.open(data) as shard:
        gone = {row.seq: None for row in shard.rows(LESSON)}
        shard.erase({LESSON: gone}, at_ns=9, renamed={LESSON: "erased-1"})


def test_a_lesson_loses_name_and_content_at_once_or_not_at_all(tmp_path: Path) -> None:
    data = tmp_path / "data"
    others = journal(data)
    outcomes, code, moment = set(), -signal.SIGKILL, 0
    while code != 0:
        moment += 1
        copy = tmp_path / "copy"
        shutil.copytree(data, copy)
        code = code_when_killed_at(moment, erase_lesson, copy)
        assert code in {0, -signal.SIGKILL}
        Shard.open(copy).close()
        left = [row for row in read_rows(copy) if row.session != "s2"]
        whole = holding(copy, PERSON.encode()) != []
        assert {row.session for row in left} == {LESSON if whole else "erased-1"}
        assert {row.body is None for row in left} == {not whole}
        assert list(read_rows(copy, "s2")) == others
        found = verify(copy)
        assert (found.ok, found.labels, found.erased) == (True, 50, 0 if whole else 25)
        outcomes.add(whole)
        shutil.rmtree(copy)
    assert outcomes == {True, False}
    assert moment > 10
