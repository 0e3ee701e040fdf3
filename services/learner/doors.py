"""What a learner serves, watches and announces; withdrawn when it loses its shard.

One learner alone serves the keys of all sessions. Of several, each serves the answers to its own sessions;
what names no session in its key, or one that may not exist, all of them hear, and only the owner replies.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from protocol.keys import KeyNameError

if TYPE_CHECKING:
    from collections.abc import Callable

    from services.learner.service import Learner
    from services.runtime.bus import Request


class Doors:
    """Everything that a learner has declared on its bus."""

    def __init__(self, learner: Learner) -> None:
        self._learner = learner
        self._open: list[Callable[[], None]] = []
        self._alone = learner.config.shards == 1

    def open(self) -> None:
        """Serve and watch from now on, and say that the shard has a learner."""
        learner = self._learner
        keys, bus, reception = learner.keys, learner.bus, learner.reception
        enqueue_presence = partial(learner.loop.enqueue, learner.on_presence)
        self._open.append(bus.watch(keys.presences(), enqueue_presence))
        if self._alone:
            self._serve(keys.answer(), reception.on_answer)
        else:
            for name in learner.sessions:
                self._serve(keys.answer(name), reception.on_answer)
        self._serve_shared(keys.join(), reception.on_join, of_sessions=True)
        self._serve_shared(keys.control(), reception.on_control, of_sessions=True)
        for verb, handle in learner.office.verbs.items():
            self._serve_shared(keys.learner(verb), handle)
        tell = learner.loop.receiver(learner.standing.reply, needs_journal=False)
        self._open.append(bus.serve(learner.standing.key, tell))
        self._open.append(bus.announce(keys.service("learner", f"shard-{learner.config.shard}")))

    def open_session(self, name: str) -> None:
        """Serve the answers to a new session."""
        if not self._alone:
            self._serve(self._learner.keys.answer(name), self._learner.reception.on_answer)

    def close(self) -> None:
        """Withdraw everything, the announcement first: whoever stands by may come."""
        while self._open:
            self._open.pop()()

    def _serve(self, key: str, handle: Callable[[Request], None]) -> None:
        self._open.append(self._learner.bus.serve(key, self._learner.loop.receiver(handle)))

    def _serve_shared(
        self, key: str, handle: Callable[[Request], None], *, of_sessions: bool = False
    ) -> None:
        receive = self._learner.loop.receiver(handle)
        if of_sessions and not self._alone:
            receive = partial(self._hand_on_own, receive)
        self._open.append(self._learner.bus.serve(key, receive, shared=not self._alone))

    def _hand_on_own(self, receive: Callable[[Request], None], request: Request) -> None:
        try:
            session, _ = self._learner.keys.session_and_teacher(request.key)
        except KeyNameError:  # everybody refuses it
            receive(request)
            return
        if self._learner.owns(session):
            receive(request)
