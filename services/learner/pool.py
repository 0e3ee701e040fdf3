"""Several learners share the sessions of one data directory out in shards; who dies is followed by another.

A process of the pool has a thread for each shard that it holds, with a learner of its own. The lock of a
shard says who has it, its epoch fences whoever had it before; what is announced only says when to try.
"""

import gc
import logging
import queue
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from random import Random, SystemRandom

from protocol.keys import KeyNameError, Keys
from services.learner.config import LearnerConfig
from services.learner.ownership import agree_on_shards
from services.learner.service import opened
from services.learner.standby import Standby
from services.learner.vigil import Vigil
from services.runtime.bus import Bus, Presence
from services.runtime.clock import Clock
from services.runtime.journal.errors import JournalError, JournalFenced, JournalLocked
from services.runtime.journal.lock import is_owned
from services.runtime.journal.shard import shard_directory

log = logging.getLogger("sfid.learner")

TURN_S = 0.1
Tell = Callable[[Callable[[], None]], None]


class Pool:
    """One process of a pool of learners; everything but the learners happens on the thread of `run`."""

    def __init__(
        self, config: LearnerConfig, home: int | None, bus: Bus, clock: Clock, *, chance: Random | None = None
    ) -> None:
        self._config, self._bus, self._clock = config, bus, clock
        self._keys = Keys(config.deployment)
        self._vigil = Vigil(config, home, clock.now_ns(), chance or SystemRandom())
        self._happened: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._standby = Standby(self._keys, bus, clock, config.shards, self._happened.put)
        self._holdings: dict[int, Holding] = {}
        self._cut_off_ns: int | None = None
        """Since when there has been no router, if there is none."""
        self._awaited = home
        """The shard that must be held, or found taken, before the process is ready."""

    def run(self, ready: Callable[[], None], stop: threading.Event) -> None:
        """Hold shards until `stop` is set, then drain all of them.

        Raises: JournalError when the data directory is of another number of shards, or the home shard broken.
        """
        agree_on_shards(self._config.data_dir, self._config.shards)
        tell = self._happened.put
        watched = self._keys.service("learner")
        withdraw = self._bus.watch(watched, lambda presence: tell(partial(self._on_presence, presence)))
        self._bus.on_connection(lambda connected: tell(partial(self._on_connection, connected)))
        told = False
        try:
            while not stop.is_set():
                self._take_what_is_due()
                self._give_up_when_cut_off()
                self._standby.stands(by=not self._holdings and self._awaited is None)
                if self._awaited is None and not told:
                    told = True
                    ready()
                self._hear(TURN_S)
        finally:
            withdraw()
            self._standby.stands(by=False)
            self._drain()

    def _hear(self, timeout_s: float) -> None:
        try:
            happened = self._happened.get(timeout=timeout_s)
        except queue.Empty:
            return
        happened()

    def _take_what_is_due(self) -> None:
        shard = self._vigil.due(self._clock.now_ns()) if self._bus.connected() else None
        if shard is None:
            return
        if is_owned(shard_directory(self._config.data_dir, shard)):
            self._ended(shard, JournalLocked(f"shard {shard}: another learner has it"))
            return
        self._vigil.took(shard)
        config = replace(self._config, shard=shard)
        holding = Holding(config, self._bus, self._clock, self._happened.put, self._took, self._ended)
        self._holdings[shard] = holding
        holding.start()

    def _took(self, shard: int, sessions: int) -> None:
        log.info("shard %d is this learner's now: %d sessions", shard, sessions)
        self._settled(shard)

    def _ended(self, shard: int, error: Exception | None) -> None:
        """A shard is not, or no longer, this process's."""
        self._holdings.pop(shard, None)
        locked = isinstance(error, JournalLocked)
        fenced = isinstance(error, JournalFenced)
        failed = error is not None and not (locked or fenced)
        self._vigil.lost(shard, self._clock.now_ns(), failed=failed)
        if locked and self._awaited == shard:
            log.info("shard %d is another learner's: standing by", shard)
        elif fenced:
            log.warning("shard %d was taken by another learner: standing by (%s)", shard, error)
        elif isinstance(error, JournalError) and self._awaited == shard:
            raise error
        elif error is not None and not locked:
            log.error("shard %d has no learner here, the others go on: %s", shard, error)
        self._settled(shard)

    def _settled(self, shard: int) -> None:
        if self._awaited == shard:
            self._awaited = None

    def _on_presence(self, presence: Presence) -> None:
        try:
            _, name = self._keys.role_and_name(presence.key)
            shard = int(name.removeprefix("shard-"))
        except (KeyNameError, ValueError):  # anybody may announce anything
            return
        if presence.present:
            self._vigil.came(shard)
        else:
            self._vigil.went(shard, self._clock.now_ns())

    def _on_connection(self, connected: bool) -> None:  # noqa: FBT001 - the bus calls it with one argument
        now_ns = self._clock.now_ns()
        if connected and self._cut_off_ns is not None:
            self._vigil.reconnected(now_ns)
        self._cut_off_ns = None if connected else now_ns

    def _give_up_when_cut_off(self) -> None:
        """Let learners at another router have the sessions that nobody reaches here."""
        if self._cut_off_ns is None or not self._holdings:
            return
        if self._clock.now_ns() - self._cut_off_ns >= self._config.cut_off_ms * 1_000_000:
            log.warning("no router for %.0f s: the shards are given up", self._config.cut_off_ms / 1000)
            self._drain()
            self._holdings.clear()

    def _drain(self) -> None:
        for holding in self._holdings.values():
            holding.stop.set()
        for holding in self._holdings.values():
            holding.join()


class Holding(threading.Thread):
    """A shard and its learner, on a thread of their own until `stop` is set or the shard is lost."""

    def __init__(
        self,
        config: LearnerConfig,
        bus: Bus,
        clock: Clock,
        tell: Tell,
        took: Callable[[int, int], None],
        ended: Callable[[int, Exception | None], None],
    ) -> None:
        super().__init__(name=f"shard-{config.shard}", daemon=True)
        self.stop = threading.Event()
        self._config, self._bus, self._clock = config, bus, clock
        self._tell, self._took, self._ended = tell, took, ended

    def run(self) -> None:
        """Take the shard, serve its sessions, give it back."""
        shard = self._config.shard
        error: Exception | None = None
        try:
            with opened(self._config, self._bus, self._clock) as learner:
                self._tell(partial(self._took, shard, len(learner.sessions)))
                learner.run(self.stop)
        except JournalError as journal_error:
            # Without its traceback: that would keep requests from being dropped.
            error = journal_error.with_traceback(None)
        except Exception as fault:
            log.exception("shard %d: its learner failed", shard)
            error = RuntimeError(f"{type(fault).__name__}: {fault}")
        gc.unfreeze()  # of what stayed, this shard's sessions go
        self._tell(partial(self._ended, shard, error))


def run(
    config: LearnerConfig,
    home: int | None,
    bus: Bus,
    clock: Clock,
    ready: Callable[[], None],
    stop: threading.Event,
) -> None:
    """Hold the home shard, and every other that nobody holds, until `stop` is set."""
    Pool(config, home, bus, clock).run(ready, stop)
