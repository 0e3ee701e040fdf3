"""A classroom where tokens are required, and whoever signs them."""

from typing import Any

import msgspec

from protocol.identity import Identity, Role, sign
from services.learner.config import LearnerConfig
from services.learner.service import Learner
from services.runtime.memory_bus import MemoryBus
from services.runtime.secret import load_secrets
from tests.services.learner.classroom import Classroom

HOUR_S = 3600
ID = "00000000000000a1"
"""Of every token, unless told otherwise."""


class GuardedRoom(Classroom):
    """A classroom whose learner requires tokens."""

    def start_learner(self) -> None:
        """Open a learner that lets in nobody without a token."""
        self.shard = self.open_shard(self.data_dir)
        self.bus = MemoryBus(self.hub)
        config = LearnerConfig(self.data_dir, require_tokens=True)
        self.learner = Learner(config, self.bus, self.shard, self.clock)
        self.learner.open()
        self.settle()

    @property
    def refused_by(self) -> dict[str, int]:
        """How many requests the learner's door has refused, by fault."""
        door = self.learner.reception.desk.door
        assert door is not None
        return {fault.value: count for fault, count in door.refused.items()}

    def identity(self, name: str = "ann", hours: int = 1, **changes: Any) -> Identity:  # noqa: ANN401 - any field
        """Return who a teacher of s1 is, for so many hours, with these changes."""
        expires_s = self.clock.wall_ns() // 1_000_000_000 + hours * HOUR_S
        own = Identity(role=Role.TEACHER, session="s1", pseudonym=name, expires_s=expires_s, token_id=ID)
        return msgspec.structs.replace(own, **changes)

    def token(self, name: str = "ann", hours: int = 1, **changes: Any) -> str:  # noqa: ANN401 - any field
        """Return the signed identity."""
        return sign(self.identity(name, hours, **changes), load_secrets(self.data_dir / "gateway"))
