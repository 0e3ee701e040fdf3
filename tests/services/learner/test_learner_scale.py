"""Many sessions in one learner: what each takes, and what they share."""

import gc
import logging
import tracemalloc
from pathlib import Path

import msgspec
import pytest

from protocol.messages import CreateSession, Join, WindowSpec, World
from protocol.translate import config_of
from protocol.world_messages import Begin, Begun
from services.environment import Environment
from sfid_core.sokoban.levels import packaged
from tests.services.learner.classroom import KEYS, MS, ROOM, Classroom, Pupil, session

SESSIONS = 100
EPISODES = 30
BYTES_A_SESSION = 10_240
WINDOW_MS = 10
FRAMES = 4
"""Of each allocation; enough to tell what the environment made from what the learner made."""
NOT_THE_LEARNER = (
    "*/sfid_core/sokoban/*",
    "*/tests/*",
    "*/memory_bus.py",
    "*/tracemalloc.py",
)

# 24 boxes on 280 fields, none of them in a corner: far too many states to solve.
_BOXES = "#  " + " $ " * 12 + "  #"
_FREE = "#" + " " * 40 + "#"
HALL = "\n".join(
    ["#" * 42, _FREE, _BOXES, _FREE, _BOXES, _FREE, "#@" + "." * 24 + " " * 15 + "#", _FREE, "#" * 42]
)


def many() -> list[CreateSession]:
    """Sessions of one-step episodes, so that each soon has thirty behind it, on tables of a few states."""
    window = WindowSpec(mode="full", span_ms=WINDOW_MS)
    world = World(level=ROOM, level_name="room", starts="1", steps_max=1)
    return [
        session(session=f"s{number}", world=world, seed=number, window=window, episodes=EPISODES + 1)
        for number in range(SESSIONS)
    ]


def learners_bytes() -> int:
    """Return what is allocated now, but by the environment, the bus in memory and this test."""
    gc.collect()
    hidden = [tracemalloc.Filter(inclusive=False, filename_pattern=name) for name in NOT_THE_LEARNER]
    hidden.append(
        tracemalloc.Filter(inclusive=False, filename_pattern="*/services/environment.py", all_frames=True)
    )
    return sum(trace.size for trace in tracemalloc.take_snapshot().filter_traces(hidden).traces)


def forget_what_was_seen(room: Classroom) -> None:
    room.decisions.clear()
    room.steps.clear()
    room.episodes.clear()


def test_a_session_takes_at_most_ten_kilobytes_beside_its_table(
    room: Classroom, caplog: pytest.LogCaptureFixture
) -> None:
    """Idle, and once thirty episodes are behind it. The tables here have a few rows and are counted in."""
    caplog.set_level(logging.WARNING, "sfid")  # what is logged, the test's own handler would keep
    caplog.set_level(logging.WARNING, "sfid.learner")
    room.create(session(session="first"))
    forget_what_was_seen(room)
    tracemalloc.start(FRAMES)
    try:
        before = learners_bytes()
        for config in many():
            room.create(config)
        idle = learners_bytes()
        for number in range(SESSIONS):
            name = f"s{number}"
            room.watcher.announce(KEYS.present(name, "ann"))
            room.ask(room.watcher, KEYS.join(name, "ann"), Join(session=name, teacher="ann"))
        for span_ms in (10_000, *[WINDOW_MS] * (EPISODES - 1)):  # first, joining is over and done with
            room.pass_time(span_ms)
            forget_what_was_seen(room)
        room.learner.loop.commit()
        forget_what_was_seen(room)
        taught = learners_bytes()
    finally:
        tracemalloc.stop()
    assert {room.report(f"s{number}").summary.episode for number in range(SESSIONS)} == {EPISODES}
    assert (idle - before) / SESSIONS < BYTES_A_SESSION / 2
    assert (taught - before) / SESSIONS < BYTES_A_SESSION


def test_sessions_of_one_level_share_its_text_also_after_a_restart(room: Classroom) -> None:
    def world(level: str) -> World:
        return World(level=level, level_name="shared", starts="4")

    copied = "".join(ROOM.splitlines(keepends=True))
    assert config_of(session(world=world(copied))).world.level == ROOM  # somebody has read an equal one
    for name in ("s1", "s2"):
        room.create(session(session=name, world=world(ROOM)))
    for _ in range(2):
        one, other = (room.learner.sessions[name] for name in ("s1", "s2"))
        assert isinstance(one.config.world, World)
        texts = [live.config.world.level for live in (one, other) if isinstance(live.config.world, World)] + [
            live.session.config.world.level for live in (one, other)
        ]
        assert texts == [ROOM] * 4
        assert all(text is texts[0] for text in texts)
        room.kill_learner()
        room.start_learner()


def begun(environment: Environment, session_name: str, seed: int, episode: int = 0, **world: object) -> Begun:
    three_boxes = World(level=packaged("three-boxes")[0].to_xsb(), level_name="three boxes", starts="4")
    spec = msgspec.structs.replace(three_boxes, **world)
    asked = Begin(session=session_name, epoch=1, episode=episode, seed=seed, world=spec)
    reply = environment.handle("begin", msgspec.msgpack.encode(asked))
    assert isinstance(reply, Begun), reply
    return reply


def test_sessions_of_other_seeds_share_the_tables_of_their_level() -> None:
    """Five hundred of them are more than the environment keeps ready, and run at the same time."""
    environment = Environment()
    tracemalloc.start()
    try:
        begun(environment, "first", 0)
        one = tracemalloc.get_traced_memory()[0]
        for number in range(1, 500):
            begun(environment, f"s{number}", number)
        each = (tracemalloc.get_traced_memory()[0] - one) / 499
    finally:
        tracemalloc.stop()
    assert each < one / 5


@pytest.mark.parametrize("starts", ["1", "4", "all", "within:9"])
def test_a_world_that_shares_tables_begins_as_one_that_is_alone(starts: str) -> None:
    shared = Environment()
    begun(shared, "first", 99, starts="2")
    for seed in range(5):
        for episode in range(3):
            together = begun(shared, "s", seed, episode, starts=starts)
            assert together == begun(Environment(), "s", seed, episode, starts=starts)


def test_a_level_too_large_to_solve_is_taught_and_takes_memory_for_the_states_it_meets(
    tmp_path: Path,
) -> None:
    room = Classroom(tmp_path / "data")
    try:
        world = World(level=HALL, level_name="hall", starts="1", steps_max=60)
        room.create(session(world=world, episodes=1_000))
        ann = Pupil(room, "ann")
        ann.join()
        assert room.decision.optimal_steps is None
        learner, met, sizes = room.learner.sessions["s1"].session.learner, {room.decision.state}, []
        for number in range(120):
            action = ("RIGHT", "DOWN", "RIGHT", "UP", "LEFT")[number % 5]
            assert ann.label(room.decision, action).code == "accepted"
            met.add(room.decision.state)
            ended = room.learner.sessions["s1"].session.episode  # in a state that no decision tells of
            sizes.append((len(met), len(learner.memory.values), ended))
        width = sizes[0][1] // sizes[0][0]
        assert len(met) > 20
        assert all(states * width <= size <= (states + ends) * width for states, size, ends in sizes)
        before = learner.sha256()
        room.kill_learner()
        room.start_learner()
        assert room.learner.sessions["s1"].session.learner.sha256() == before
        assert room.clock.now_ns() < 3_600_000 * MS
    finally:
        room.shard.discard_pending()
        room.shard.close()
