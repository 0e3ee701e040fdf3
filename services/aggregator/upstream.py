"""The crowd's end towards the learner: a teacher's client that lives in the aggregator's loop."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from protocol.codec import decode, encode
from protocol.messages import Answer
from services.client import Client
from services.client.one_loop import LoopBus
from services.outbox import Outbox

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from random import Random

    from protocol.crowd_journal import Handed
    from protocol.keys import Keys
    from services.client import Update
    from services.runtime.bus import Bus
    from services.runtime.clock import Clock


RESENT = 2
"""The learner asks nothing new before it has the answer: at most one is unacknowledged."""


class Upstream:
    """One teacher of one session, present between `enter` and `leave`, as often as needed."""

    def __init__(
        self, bus: Bus, keys: Keys, session: str, name: str, *, wake: Callable[[], None], clock: Clock,
        chance: Random, token: str | None,
    ) -> None:  # fmt: skip
        self._line = LoopBus(bus, wake)
        self.name = name
        self._keys, self._session = keys, session
        self._clock, self._chance, self._token = clock, chance, token
        self._client: Client | None = None

    @property
    def present(self) -> bool:
        """Whether the crowd is (or asks to be) one of the learner's teachers."""
        return self._client is not None

    @property
    def unacknowledged(self) -> int:
        """How many answers the learner has not acknowledged yet."""
        return 0 if self._client is None else self._client.unacknowledged

    def enter(self, handed: Iterable[Handed] = ()) -> None:
        """Join the session; twice is once.

        Args: handed: what was handed on before a crash; the last of it is sent again, under the same id.
        """
        if self._client is not None:
            return
        outbox = Outbox()  # the journal keeps what is handed on, and `handed` brings it back
        for one in list(handed)[-RESENT:]:
            message = decode(one.payload, Answer)
            outbox.store(message.answer_id, encode(self._signed(message)))
        self._client = Client(
            self._line, self._keys, self._session, self.name,
            outbox=outbox, clock=self._clock, token=self._token, chance=self._chance,
        )  # fmt: skip
        self._client.__enter__()

    def leave(self) -> None:
        """Be gone for the learner; twice is once."""
        if self._client is not None:
            self._client.close()
            self._line.release()
            self._client = None

    def send(self, message: Answer) -> None:
        """Hand on an answer until it is acknowledged; it is in the journal."""
        if self._client is not None:
            self._client.send(self._signed(message))

    def updates(self) -> Iterator[Update]:
        """Yield what has happened, and repeat what is due."""
        while self._client is not None and (update := self._client.next(0)) is not None:
            yield update

    def _signed(self, message: Answer) -> Answer:
        return message if self._token is None else msgspec.structs.replace(message, token=self._token)
