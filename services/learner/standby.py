"""A process of a pool that holds no shard: it is seen, and tells how it does, like those that hold some."""

import secrets
from collections.abc import Callable
from functools import partial

from protocol.keys import Keys
from services.runtime.bus import Bus, Request
from services.runtime.clock import Clock
from services.runtime.status import StatusDesk

Tell = Callable[[Callable[[], None]], None]


class Standby:
    """Announces a process while it stands by, under a name of its own, and answers how it does.

    Args: tell: hands a request on to the thread that calls `stands`.
    """

    def __init__(self, keys: Keys, bus: Bus, clock: Clock, shards: int, tell: Tell) -> None:
        self.name = f"standby-{secrets.token_hex(4)}"
        self._keys, self._bus, self._tell = keys, bus, tell
        self._desk = StatusDesk("learner", self.name, clock, lambda: {"shards": shards})
        self._open: list[Callable[[], None]] = []

    def stands(self, *, by: bool) -> None:
        """Be seen from now on, or no longer; the same again changes nothing."""
        if by and not self._open:
            self._open.append(self._bus.serve(self._keys.status("learner", self.name), self._hand_on))
            self._open.append(self._bus.announce(self._keys.service("learner", self.name)))
        while self._open and not by:
            self._open.pop()()

    def _hand_on(self, request: Request) -> None:
        self._tell(partial(self._desk.reply, request))
