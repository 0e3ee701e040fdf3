"""Power cuts of the journal on a simulated disk: what was acknowledged is there in the next life, once."""

import random
import tempfile
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from services.runtime.journal import JournalError, verify
from services.runtime.timeline import Timeline
from services.simulate.disk import Disk, DiskFaults, PowerCut, SimulatedShard

CUTS_A_JOURNAL = 25
CUT, FAILS = 0.5, 0.1
COMMIT_EVERY_NS = 500_000_000
SESSIONS = ("s0", "s1", "s2")


class Cuts(NamedTuple):
    """What came of the power cuts."""

    cuts: int
    acknowledged: int
    lost: int
    twice: int
    unproven: int
    """Journals that `verify` found fault with afterwards."""
    fates: dict[str, int]


def cut_power(cuts: int, seed: int, root: Path) -> Cuts:
    """Append, commit and lose power until that has happened `cuts` times; look at all rows after each."""
    fates: Counter[str] = Counter()
    acknowledged = lost = twice = unproven = 0
    done = 0
    while done < cuts:
        with tempfile.TemporaryDirectory(dir=root) as directory:
            one = _Journal(Path(directory), random.Random(f"{seed}/{done}"))
            done += one.live(min(CUTS_A_JOURNAL, cuts - done))
            acknowledged += len(one.acknowledged)
            lost, twice, unproven = lost + one.lost, twice + one.twice, unproven + one.unproven
            fates.update(fate.name for fate in one.disk.fates)
    return Cuts(done, acknowledged, lost, twice, unproven, dict(sorted(fates.items())))


class _Journal:
    def __init__(self, root: Path, chance: random.Random) -> None:
        self.chance = chance
        self.timeline = Timeline()
        self.disk = Disk(root, self.timeline, chance, DiskFaults(fails=FAILS, cut=CUT))
        self.acknowledged: dict[bytes, bytes] = {}
        self.lost = self.twice = self.unproven = 0

    def live(self, cuts: int) -> int:
        """Go through so many lives; each begins with what the last one had made durable."""
        for life in range(cuts):
            # A cut is no damage: what it leaves is completed by opening, not repaired.
            self.unproven += life > 0 and not verify(self.disk.data_dir).ok
            shard = self.disk.open()
            self._look(shard)
            try:
                while True:
                    self._commit(shard)
            except PowerCut:
                shard.abandon()
        self.disk.faults = DiskFaults()
        with self.disk.open() as last:
            self._look(last)
        self.unproven += not verify(self.disk.data_dir).ok
        return cuts

    def _commit(self, shard: SimulatedShard) -> None:
        self.timeline.advance(COMMIT_EVERY_NS)
        said = {
            self.chance.randbytes(16): self.chance.randbytes(60) for _ in range(self.chance.randint(1, 5))
        }
        for unique, body in said.items():
            session = self.chance.choice(SESSIONS)
            shard.append(session, "answer", body, at_ns=0, unique=unique, person="ann")
        try:
            shard.commit()
        except JournalError:
            shard.discard_pending()  # nobody was told that these are saved
        else:
            self.acknowledged |= said

    def _look(self, shard: SimulatedShard) -> None:
        found = [row for row in shard.rows() if row.kind == "answer"]
        counts = Counter(row.unique for row in found)
        bodies = {row.unique: row.body for row in found}
        self.lost += sum(bodies.get(unique) != body for unique, body in self.acknowledged.items())
        self.twice += sum(count > 1 for count in counts.values())
