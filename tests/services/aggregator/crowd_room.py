"""A learner, an environment, an aggregator and its crowd on one bus in memory, under a clock a test moves."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from protocol.codec import decode
from protocol.crowd_journal import FoldedCrowd, fold_crowd
from protocol.crowd_message import Crowd
from protocol.journal import Record, read_answer_body
from protocol.keys import Keys
from protocol.messages import Acknowledgement, Answer, Decision, WindowSpec
from services.aggregator.config import AggregatorConfig
from services.aggregator.optima import Optima
from services.aggregator.service import Aggregator
from services.runtime.bus import Received
from services.runtime.journal import Row, Shard
from services.runtime.memory_bus import MemoryBus
from tests.services.learner.classroom import KEYS, Classroom, Speaker

CROWD_KEYS = Keys("local-crowd")
EARLY = WindowSpec(mode="early", span_ms=1_000)


class Member(Speaker):
    """A worker's end of the wire."""

    keys = CROWD_KEYS
    response_ms = 250

    def __init__(self, room: "CrowdRoom", name: str) -> None:
        super().__init__(room, name)
        self.room: CrowdRoom = room

    def label(self, action: str, decision: Decision | None = None) -> str:
        """Name an action for the decision as it stands; return the code of the acknowledgement."""
        message = self.message(decision or self.room.asked, action=action)
        return decode(self.send(message).payload, Acknowledgement).code

    def say(self, **changes: Any) -> str:  # noqa: ANN401 - any field
        message = self.message(self.room.asked, **changes)
        return decode(self.send(message).payload, Acknowledgement).code

    def leave(self) -> None:
        self.withdraw()
        self.room.settle()


@dataclass
class CrowdRoom(Classroom):
    """A classroom with an aggregator; `asked` is what the crowd sees."""

    config: dict[str, Any] = field(default_factory=dict)
    seen: list[Decision] = field(default_factory=list)
    crowd_measures: list[bytes] = field(default_factory=list)
    reports: list[Crowd] = field(default_factory=list)
    actors: list[Callable[[], None]] = field(default_factory=list)
    """Whoever else has a turn of their own."""

    def __post_init__(self) -> None:
        self.aggregator: Aggregator | None = None
        # Apart from the learner's: one of the two is killed at a time.
        self.crowd_dir = self.data_dir.with_name("crowd-data")
        super().__post_init__()
        self.watcher.subscribe(CROWD_KEYS.decision(), self._see_asked)
        self.watcher.subscribe(CROWD_KEYS.measures(), lambda one: self.crowd_measures.append(one.payload))
        self.watcher.subscribe(KEYS.crowd(), lambda one: self.reports.append(decode(one.payload, Crowd)))
        self.start_aggregator()

    def start_aggregator(self) -> None:
        """Open an aggregator on the data directory."""
        config = AggregatorConfig(self.crowd_dir, **self.config)
        self.crowd_shard = Shard.open(config.journal_dir)
        self.crowd_bus = MemoryBus(self.hub)
        optima = Optima(lambda work: work())
        self.aggregator = Aggregator(config, self.crowd_bus, self.crowd_shard, self.clock, optima=optima)
        self.aggregator.open()
        self.settle()

    def kill_aggregator(self) -> None:
        """Leave it as `kill -9` does: what was not committed is gone, nothing is flushed or said."""
        self.crowd_bus.close()
        directory = self.crowd_dir / "crowd-crowd"
        image = self.crowd_dir / "image"
        shutil.copytree(directory, image, ignore=shutil.ignore_patterns("*-shm"))
        self.crowd_shard.discard_pending()
        self.crowd_shard.close()
        shutil.rmtree(directory)
        image.rename(directory)
        self.aggregator = None
        self.settle()

    def close(self) -> None:
        self.crowd_shard.close()
        self.shard.close()

    def _turned(self) -> bool:
        if self.aggregator is not None:
            self.aggregator.turn(0.0)
        for turn in self.actors:
            turn()
        return super()._turned()

    @property
    def asked(self) -> Decision:
        """The decision as the crowd sees it."""
        return self.seen[-1]

    def members(self, *names: str) -> list[Member]:
        """Return members of these names who have joined."""
        members = [Member(self, name) for name in names]
        for member in members:
            member.join()
        return members

    def crowd_rows(self, kind: str | None = None) -> list[Row]:
        """Return the rows of the aggregator's journal, of one kind if it is named."""
        return [row for row in self.crowd_shard.rows() if kind in {None, row.kind}]

    def folded(self, *without: str) -> FoldedCrowd:
        """Return what the aggregator's journal builds."""
        rows = [Record(row.kind, row.at_ns, row.body) for row in self.crowd_rows() if row.body is not None]
        folded = fold_crowd(rows, without)
        assert folded is not None
        return folded

    def learner_answers(self) -> list[Answer]:
        """Return the answers in the learner's journal."""
        bodies = [row.body for row in self.rows("answer") if row.body is not None]
        return [decode(read_answer_body(body)[2], Answer) for body in bodies]

    def _see_asked(self, received: Received) -> None:
        self.seen.append(decode(received.payload, Decision))
