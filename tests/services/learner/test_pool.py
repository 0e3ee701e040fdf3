"""A pool of learners: processes on a common bus and storage, each here a thread; who leaves is followed."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Join, Refusal, Welcome
from services.environment import Environment
from services.learner.config import LearnerConfig
from services.learner.ownership import agree_on_shards, shard_of
from services.learner.pool import Pool
from services.operations.status import survey
from services.operator import Operator
from services.runtime.bus import Reply, Request
from services.runtime.clock import SystemClock
from services.runtime.journal import JournalError, Shard, read_rows, shard_directory, verify
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.cli.command_line import wait_for
from tests.services.learner.classroom import session

KEYS = Keys("local")
SHARDS = 3
SHARD_NAMES = {"shard-0", "shard-1", "shard-2"}
DEADLINE_S = 30.0
NAMES = tuple(f"s{number}" for number in range(9))
QUICK = {"takeover_ms": 100, "settle_ms": 1_500, "burden_ms": 20, "jitter_ms": 20, "cut_off_ms": 300}


@dataclass
class Process:
    """One learner process of the pool."""

    hub: MemoryHub
    data_dir: Path
    home: int | None
    shards: int = SHARDS
    limits: dict[str, int] = field(default_factory=lambda: QUICK)
    stop: threading.Event = field(default_factory=threading.Event)
    ready: threading.Event = field(default_factory=threading.Event)
    error: Exception | None = None

    def __post_init__(self) -> None:
        self.bus = MemoryBus(self.hub)
        config = LearnerConfig(self.data_dir, shards=self.shards, **self.limits)  # type: ignore[arg-type]
        self.pool = Pool(config, self.home, self.bus, SystemClock())
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.pool.run(self.ready.set, self.stop)
        except JournalError as error:
            self.error = error
        self.bus.close()

    def end(self) -> None:
        self.stop.set()
        self.thread.join(DEADLINE_S)
        assert not self.thread.is_alive()

    @property
    def holds(self) -> set[int]:
        return {
            int(token.rpartition("-")[2]) for token in tuple(self.bus.tokens) if "/learner/shard-" in token
        }


class Building:
    """Where the processes are."""

    def __init__(self, data_dir: Path) -> None:
        self.data_dir = data_dir
        self.hub = MemoryHub(SystemClock(), inline=True)
        self.bus = MemoryBus(self.hub)
        self.operator = Operator(self.bus, KEYS)
        self.processes: list[Process] = []
        self.limits = QUICK
        environment, lock = Environment(), threading.Lock()

        def server(verb: str) -> Callable[[Request], None]:
            def serve(request: Request) -> None:
                with lock:
                    reply = environment.handle(verb, request.payload)
                (request.reply_error if isinstance(reply, Refusal) else request.reply)(encode(reply))

            return serve

        for verb in ("begin", "execute"):
            self.bus.serve(KEYS.environment(verb), server(verb))

    def start(self, home: int | None, shards: int = SHARDS) -> Process:
        process = Process(self.hub, self.data_dir, home, shards, self.limits)
        self.processes.append(process)
        return process

    def start_all(self) -> list[Process]:
        started = [self.start(home) for home in range(SHARDS)]
        wait_for("each has its home", lambda: self.held() == [{home} for home in range(SHARDS)])
        return started

    def create_all(self) -> None:
        for name in NAMES:
            self.operator.create(session(session=name))

    def epoch_of(self, name: str) -> int:
        return self.operator.show(name)[0].epoch

    def join(self, name: str) -> Welcome:
        replies: list[Reply | None] = []
        self.bus.announce(KEYS.present(name, "ann"))
        self.bus.ask(KEYS.join(name, "ann"), encode(Join(session=name, teacher="ann")), replies.append, 5_000)
        wait_for("a welcome", lambda: bool(replies))
        assert replies[0] is not None
        return decode(replies[0].payload, Welcome)

    def held(self) -> list[set[int]]:
        return [process.holds for process in self.processes]


@pytest.fixture
def building(tmp_path: Path) -> Iterator[Building]:
    made = Building(tmp_path / "data")
    yield made
    for process in made.processes:
        process.end()


def learners(building: Building) -> dict[str, bool]:
    """Return the learners that `sfid status` would list, and whether they are ready."""
    return {one.name: one.ready for one in survey(building.bus, (KEYS,)) if one.role == "learner"}


def test_the_shards_of_a_learner_that_leaves_go_on_in_the_others(building: Building) -> None:
    first, second, third = building.start_all()
    building.create_all()
    moved = [name for name in NAMES if shard_of(name, SHARDS) == 0]
    before = {name: building.join(name).epoch for name in NAMES}
    first.end()
    wait_for("somebody has its shard", lambda: second.holds | third.holds == {0, 1, 2})
    assert second.holds.isdisjoint(third.holds)
    assert sorted(one.session for one in building.operator.sessions().sessions) == sorted(NAMES)
    after = {name: building.epoch_of(name) for name in NAMES}
    assert after == {name: before[name] + (name in moved) for name in NAMES}
    assert moved
    building.operator.create(session(session=moved[0]))  # the same again is the same session
    for process in (second, third):
        process.end()
    found = verify(building.data_dir)
    assert (found.ok, found.sessions) == (True, len(NAMES))


def test_a_learner_that_comes_back_finds_its_shard_taken_and_stands_by(building: Building) -> None:
    first, second, third = building.start_all()
    first.end()
    wait_for("somebody has its shard", lambda: second.holds | third.holds == {0, 1, 2})
    back = building.start(0)
    assert back.ready.wait(DEADLINE_S)
    assert back.holds == set()
    wait_for("it is seen", lambda: len(seen := learners(building)) == 4 and all(seen.values()))
    (standby,) = {*learners(building)} - SHARD_NAMES
    assert standby.startswith("standby-")
    for process in (second, third):  # of two who stand by, either may be the quicker for every shard
        process.end()
    wait_for("it has all", lambda: back.holds == {0, 1, 2})
    wait_for("it stands by no longer", lambda: set(learners(building)) == SHARD_NAMES)


def test_one_learner_alone_takes_all_shards_once_the_others_had_time_to_come(building: Building) -> None:
    only = building.start(1)
    assert only.ready.wait(DEADLINE_S)
    wait_for("it has all", lambda: only.holds == {0, 1, 2})
    building.create_all()
    assert sorted(one.session for one in building.operator.sessions().sessions) == sorted(NAMES)


def test_a_learner_without_a_home_is_ready_and_takes_what_is_free(building: Building) -> None:
    idle = building.start(None)
    assert idle.ready.wait(DEADLINE_S)
    wait_for("it has all", lambda: idle.holds == {0, 1, 2})


def test_a_fenced_learner_gives_up_that_shard_alone_and_stands_by_for_it(building: Building) -> None:
    slow = building.start(0)
    wait_for("it has all", lambda: slow.holds == {0, 1, 2})
    building.create_all()
    mine = next(name for name in NAMES if shard_of(name, SHARDS) == 1)
    # What a storage does that has lost the lock of somebody it took for dead.
    (shard_directory(building.data_dir, 1) / "lock").unlink()
    with Shard.open(building.data_dir, 1) as other:
        epoch = other.epoch
        building.bus.ask(KEYS.join(mine, "ann"), encode(Join(session=mine, teacher="ann")), print, 5_000)
        wait_for("it gives the shard up", lambda: slow.holds == {0, 2})
        assert [row.kind for row in other.rows(mine)].count("joined") == 0
    wait_for("it has it again", lambda: slow.holds == {0, 1, 2})
    assert building.join(mine).epoch == epoch + 1
    slow.end()
    assert [row.kind for row in read_rows(building.data_dir, mine)].count("joined") == 1
    assert verify(building.data_dir).problems == ()


def test_a_shard_that_is_locked_is_left_alone_though_nobody_has_announced_it(building: Building) -> None:
    agree_on_shards(building.data_dir, SHARDS)
    with Shard.open(building.data_dir, 1):  # as a process that is stopped, and may wake up at any moment
        process = building.start(1)
        assert process.ready.wait(DEADLINE_S)
        wait_for("it has the others", lambda: process.holds == {0, 2})
    wait_for("it has all", lambda: process.holds == {0, 1, 2})


def test_the_shards_of_a_learner_that_is_cut_off_go_on_where_there_is_a_router(building: Building) -> None:
    first, second, third = building.start_all()
    building.create_all()
    moved = next(name for name in NAMES if shard_of(name, SHARDS) == 2)
    before = building.join(moved).epoch
    third.bus.set_online(online=False)
    wait_for("somebody else has its shard", lambda: first.holds | second.holds == {0, 1, 2})
    assert building.epoch_of(moved) == before + 1
    third.bus.set_online(online=True)
    for process in (first, second):
        process.end()
    wait_for("it takes part again", lambda: third.holds == {0, 1, 2})


def test_a_moment_without_a_router_moves_nothing(building: Building) -> None:
    building.limits = QUICK | {"cut_off_ms": 60_000}  # on a busy machine a moment is long
    first, second, third = building.start_all()
    building.create_all()
    epochs = {name: building.join(name).epoch for name in NAMES}
    for process in (first, second, third):
        process.bus.set_online(online=False)
    for process in (first, second, third):
        process.bus.set_online(online=True)
    assert building.held() == [{0}, {1}, {2}]
    assert {name: building.epoch_of(name) for name in NAMES} == epochs


def test_another_number_of_shards_is_refused(building: Building) -> None:
    building.start(0).ready.wait(DEADLINE_S)
    wrong = building.start(0, shards=5)
    wrong.thread.join(DEADLINE_S)
    assert "its sessions lie in 3 shards, not in 5: pass --shards 3" in str(wrong.error)
    assert not wrong.ready.is_set()


def test_a_home_shard_that_is_broken_is_told_and_ends_the_process(building: Building) -> None:
    shard_directory(building.data_dir, 0).mkdir(parents=True)
    (building.data_dir / "shards").write_text("3\n")
    (shard_directory(building.data_dir, 0) / "epoch").write_text("4\n")
    broken = building.start(0)
    broken.thread.join(DEADLINE_S)
    assert "both journal files are missing" in str(broken.error)
    assert not broken.ready.is_set()


def test_a_broken_shard_takes_none_of_the_others_with_it(
    building: Building, caplog: pytest.LogCaptureFixture
) -> None:
    agree_on_shards(building.data_dir, SHARDS)
    Shard.open(building.data_dir, 2).close()
    for path in shard_directory(building.data_dir, 2).iterdir():
        path.write_bytes(b"not a journal")
    process = building.start(0)
    wait_for("it says so", lambda: "shard 2 has no learner here, the others go on" in caplog.text)
    wait_for("it has the others", lambda: process.holds == {0, 1})
    assert process.error is None
