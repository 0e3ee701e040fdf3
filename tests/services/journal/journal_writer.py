"""A writer to be killed or starved: it prints an answer's id only after the commit returned.

Usage: journal_writer.py DATA_DIR SEED GROUPS (0 for no end). After an error it tries the same group again.
"""

from __future__ import annotations

import random
import sys
from itertools import count
from pathlib import Path

from services.runtime.journal import JournalError, Shard

TRIES = 5


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def commit_stubbornly(shard: Shard) -> None:
    for attempt in range(TRIES):
        try:
            shard.commit()
        except JournalError as error:
            say(f"error {error}")
            if attempt + 1 == TRIES:
                raise
        else:
            return


def main() -> None:
    data_dir, seed, groups = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    rng = random.Random(seed)
    with Shard.open(data_dir) as shard:
        say(f"open {shard.epoch}")
        for number in count():
            if number == groups > 0:
                break
            ids = [rng.randbytes(16) for _ in range(rng.randint(1, 5))]
            for unique in ids:
                body = unique + rng.randbytes(rng.randrange(200))
                shard.append(f"s{rng.randrange(3)}", "answer", body, at_ns=number, unique=unique, person="p1")
            commit_stubbornly(shard)
            for unique in ids:
                say(f"acked {unique.hex()}")


main()
