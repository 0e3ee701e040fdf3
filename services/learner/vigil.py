"""When a shard that has no learner may be taken: who is there, and for how long nobody was."""

from dataclasses import dataclass
from random import Random

from services.learner.config import LearnerConfig

MS = 1_000_000
FAILED_MS = 10_000
"""After so long a shard is tried again whose learner could not be started, or failed."""


@dataclass(frozen=True, slots=True)
class Stand:
    """How things stand with one shard."""

    free_ns: int
    """From when on it may be taken, if nobody is there."""
    there: bool = False
    """Whether a learner has announced itself."""


class Vigil:
    """A watch over the shards of a deployment; pure: times are arguments, in ns of one clock.

    Who has many shards waits longer for one more, so that those of a dead learner spread over the others.

    Args: home: taken without waiting; chance: of two who wait, one should come first.
    """

    def __init__(self, config: LearnerConfig, home: int | None, now_ns: int, chance: Random) -> None:
        self._config, self._chance = config, chance
        self.held: set[int] = set()
        later_ns = now_ns + config.settle_ms * MS
        self._stands = {
            shard: Stand(now_ns if shard == home else self._about(later_ns)) for shard in range(config.shards)
        }

    def came(self, shard: int) -> None:
        """A learner has announced itself for it; it may be this process's own."""
        if shard in self._stands:
            self._stands[shard] = Stand(self._stands[shard].free_ns, there=True)

    def went(self, shard: int, now_ns: int) -> None:
        """The learner of a shard is gone."""
        if shard in self._stands:
            self._free(shard, now_ns + self._config.takeover_ms * MS)

    def reconnected(self, now_ns: int) -> None:
        """Who was cut off has seen everybody go: those who are still there need a moment to be seen."""
        for shard, stand in self._stands.items():
            if not stand.there:
                self._free(shard, now_ns + self._config.takeover_ms * MS)

    def due(self, now_ns: int) -> int | None:
        """Return the shard that has been free the longest of those that may be taken now."""
        burden_ns = len(self.held) * self._config.burden_ms * MS
        free = [
            (stand.free_ns, shard)
            for shard, stand in self._stands.items()
            if shard not in self.held and not stand.there and stand.free_ns + burden_ns <= now_ns
        ]
        return min(free)[1] if free else None

    def took(self, shard: int) -> None:
        """This process has it, or is about to."""
        self.held.add(shard)

    def lost(self, shard: int, now_ns: int, *, failed: bool = False) -> None:
        """This process has it no more: it waits for it like for any other."""
        self.held.discard(shard)
        wait_ms = FAILED_MS if failed else self._config.takeover_ms
        there = self._stands[shard].there
        self._free(shard, now_ns + wait_ms * MS)
        self._stands[shard] = Stand(self._stands[shard].free_ns, there)

    def _free(self, shard: int, at_ns: int) -> None:
        self._stands[shard] = Stand(self._about(at_ns))

    def _about(self, at_ns: int) -> int:
        return at_ns + self._chance.randrange(self._config.jitter_ms * MS + 1)
