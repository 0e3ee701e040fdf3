"""Configuration of a learner service."""

from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class LearnerConfig:
    """One learner process: where its journal is, and its limits."""

    data_dir: Path
    deployment: str = "local"
    shard: int = 0
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
