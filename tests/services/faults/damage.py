"""Bits flipped and ends cut off in a journal's files, one file at a time."""

import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from services.runtime.journal import JournalError, JournalNewer, Row, Shard, read_rows, verify

FILES = ("journal.sqlite", "journal.sqlite-wal", "journal.mirror")
ROWS, ROWS_A_COMMIT = 48, 4


class Damage(NamedTuple):
    """What came of damaging copies of a journal."""

    damaged: int
    told: int
    """`verify` named the damage."""
    mended: int
    """`verify` noted what the next opening completes: damage at the end looks like an unfinished write."""
    harmless: int
    """Nothing that anybody can read had changed: a byte in a page's free space, or of a checkpointed WAL."""
    unnoticed: int
    """Rows were lost or changed and nobody was told."""
    lost: int
    """Journals of which an opening returned other rows than were acknowledged, or which could not go on."""
    refused: int
    """Openings refused because a newer version seems to have written the file: every byte is kept."""


def write_journal(to: Path, *, closed: bool) -> list[Row]:
    """Write the journal that a stop leaves, or a power cut: half of it in the WAL; return its rows."""
    live = to.with_name(f"{to.name}-live")
    chance = random.Random(7)
    rows: list[Row] = []
    for half in (0, 1):
        with Shard.open(live) as shard:
            for number in range(half * ROWS // 2, (half + 1) * ROWS // 2):
                unique, body = number.to_bytes(16, "big"), chance.randbytes(chance.randrange(20, 200))
                shard.append(f"s{number % 3}", "answer", body, at_ns=number, unique=unique, person="ann")
                if number % ROWS_A_COMMIT == ROWS_A_COMMIT - 1:
                    shard.commit()
            rows = list(shard.rows())
            if half and not closed:
                shutil.copytree(live, to, ignore=shutil.ignore_patterns("*-shm"))
    if closed:
        shutil.copytree(live, to)
    shutil.rmtree(live)
    return rows


def flip_bits(flips: int, seed: int, root: Path) -> Damage:
    """Flip one bit of one file of a copy, so often, over all files."""

    return _damage(flips, random.Random(seed), root, _flipped)


def cut_ends(cuts: int, seed: int, root: Path) -> Damage:
    """Cut one file of a copy short, half of the times within its last KiB."""

    return _damage(cuts, random.Random(seed), root, _cut)


def _flipped(content: bytearray, chance: random.Random) -> bytearray:
    bit = chance.randrange(len(content) * 8)
    content[bit // 8] ^= 1 << (bit % 8)
    return content


def _cut(content: bytearray, chance: random.Random) -> bytearray:
    if chance.random() < 0.5:  # near the end, where the last commits are
        return content[: -chance.randint(1, min(len(content), 1_024))]
    return content[: chance.randrange(len(content))]


class _Copy:
    """A copy of the journal, one file of which is damaged and made whole again."""

    def __init__(self, root: Path, rows: list[Row], source: Path) -> None:
        self.rows, self.source = rows, source
        files = [source / "shard-0" / name for name in FILES]
        self.contents = {file.name: file.read_bytes() for file in files if file.exists()}
        self.directory = root / "copy"

    def with_damage(self, name: str, content: bytearray) -> Path:
        """Lay all files down, one of them damaged; return the data directory."""
        shutil.rmtree(self.directory, ignore_errors=True)
        shutil.copytree(self.source, self.directory)
        (self.directory / "shard-0" / name).write_bytes(content)
        return self.directory


def _damage(
    times: int, chance: random.Random, root: Path, change: Callable[[bytearray, random.Random], bytearray]
) -> Damage:
    copies = []
    for name in ("cut", "closed"):
        rows = write_journal(root / name, closed=name == "closed")
        copies.append(_Copy(root, rows, root / name))
    found = dict.fromkeys(Damage._fields, 0) | {"damaged": times}
    for number in range(times):
        copy = copies[number % 2]
        rows, name = copy.rows, list(copy.contents)[number // 2 % len(copy.contents)]
        data_dir = copy.with_damage(name, change(bytearray(copy.contents[name]), chance))
        found[_noticed(data_dir, rows)] += 1
        kept = _opened(data_dir, rows)
        if kept is not None:
            found[kept] += 1
    return Damage(**found)


def _noticed(data_dir: Path, rows: list[Row]) -> str:
    """Return how `verify` takes it."""
    verified = verify(data_dir)
    if verified.problems:
        return "told"
    # What it accepts, it has to stand for: every row, as it was.
    try:
        whole = list(read_rows(data_dir)) == rows
    except JournalError:
        whole = False
    if verified.notes:
        return "mended" if whole or _ends_early(data_dir, rows) else "unnoticed"
    return "harmless" if whole and verified.rows == len(rows) else "unnoticed"


def _ends_early(data_dir: Path, rows: list[Row]) -> bool:
    """Whether readers see all rows but those of the last commit, which the next opening brings back."""
    return list(read_rows(data_dir)) == rows[:-ROWS_A_COMMIT]


def _opened(data_dir: Path, rows: list[Row]) -> str | None:
    """Open the journal and write one more row; return what is wrong."""
    try:
        with Shard.open(data_dir) as shard:
            found = [shard.find(row.session, row.unique or b"") for row in shard.rows()]
            shard.append("s0", "answer", b"more", at_ns=ROWS, unique=b"m" * 16, person="ann")
    except JournalNewer:
        return "refused"
    except JournalError:
        return "lost"
    return None if found == rows and verify(data_dir).ok else "lost"
