"""Configuration of a learner service."""

from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class LearnerConfig:
    """One learner process: where its journal is, and its limits."""

    data_dir: Path
    deployment: str = "local"
    shard: int = 0
    shards: int = 1
    """Shards of the data directory; more than one are shared out between the learners of a pool."""
    takeover_ms: int = 2_000
    """For how long nobody has held a shard before another learner of the pool takes it: time to restart."""
    settle_ms: int = 15_000
    """The same for a learner that has just started: the others may start as well."""
    cut_off_ms: int = 5_000
    """A learner of a pool that reaches no router for so long gives its shards up to those who do."""
    burden_ms: int = 250
    """By how much each shard that it holds makes a learner wait longer for one more."""
    jitter_ms: int = 500
    """Up to how much longer a learner waits, by chance."""
    inbox_max: int = 16_384
    """Messages waiting, at most: a second of 32 teachers at full speed. More are refused with "busy"."""
    waiting_max: int = 32
    """Of these, messages of one sender and kind: who floods holds up themselves. Some 5 ms of the loop."""
    commit_every_ms: int = 500
    """How long a row that nobody waits for may stay undurable."""
    teachers_gone_ms: int = 5_000
    """After a restart: how long a teacher's token may take to come back before the teacher counts as gone."""
    sessions_max: int = 10_000
    teachers_max: int = 1_000
    """Direct teachers of one session."""
    require_tokens: bool = False
    """Whether teachers are let in only with a token that the secret of `data_dir` has signed."""
    check_secrets: tuple[bytes, ...] = field(default=(), repr=False)
    """What keys the checks of acknowledgements; empty: they have no key."""
