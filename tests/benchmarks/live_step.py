"""CPU time of one live step in the learner, without transport and disk.

    .venv/bin/python tests/benchmarks/live_step.py [--json] [--steps 50000]

One step is what a learner does between a teacher's bytes and the bytes of the acknowledgement: decode and
validate the answer, advance the session (the window closes), put the answer's and the step's rows into an
open group, advance it again (learn, choose, open the next decision), check and encode the acknowledgement.
Inputs are recorded beforehand from a session on the packaged room, so that nothing of the world or the
teacher is in the figures. Each step is timed on the thread's CPU clock, the parts in a run of their own; the
clock's own time is taken off.
"""

import argparse
import gc
import json
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import blake2b
from itertools import pairwise

from protocol.codec import decode, encode
from protocol.journal import answer_body, step_body
from protocol.messages import Acknowledgement, Answer
from protocol.translate import answer_given
from sfid_core.experiments.batch import world_of
from sfid_core.session.config import SessionConfig, Window, WindowMode, WorldSpec
from sfid_core.session.effects import Acknowledge
from sfid_core.session.events import EpisodeBegan, StepTaken, TeacherJoined
from sfid_core.session.machine import advance
from sfid_core.session.state import Phase, Session, new_session
from sfid_core.sokoban.actions import ACTIONS
from sfid_core.sokoban.levels import packaged
from sfid_core.teaching.kernels import TeacherParameters
from sfid_core.teaching.simulated import SimulatedTeacher

NAMES = tuple(action.name for action in ACTIONS)
NUMBERS = {name: index for index, name in enumerate(NAMES)}
CONFIG = SessionConfig(
    "bench",
    WorldSpec(packaged("room")[0].to_xsb(), starts="all"),
    episodes=1_000_000,
    window=Window(WindowMode.UNTIL_ANSWERED, 2000),
)


@dataclass(frozen=True, slots=True)
class Input:
    """What reaches the learner for one step."""

    began: EpisodeBegan | None
    """Set at the first step of an episode."""
    payload: bytes
    taken: StepTaken


def started() -> Session:
    session = new_session(CONFIG)
    advance(session, 0, TeacherJoined("ann"))
    return session


def recorded(steps: int) -> Iterator[Input]:
    """Play a session with an erring teacher and yield what reaches its learner."""
    teacher = SimulatedTeacher(1, "ann", "bench", TeacherParameters(label_error=0.2))
    world, session = world_of(CONFIG), started()
    board = world.begin(0)
    for _ in range(steps):
        began = None
        if session.phase is Phase.BEGINNING:
            board = world.begin(session.episode)
            optimal = world.optimal_steps(board)
            began = EpisodeBegan(session.episode, board.state_key(), board.to_xsb(), optimal)
            advance(session, 0, began)
        label = teacher.label(session.decision, session.state, world.optimal_actions(board)) or 0
        message = Answer(
            answer_id=session.decision.to_bytes(16, "big"),
            session="bench",
            teacher="ann",
            epoch=1,
            decision=session.decision,
            episode=session.episode,
            step=session.step,
            state=session.state,
            kind="label",
            action=NAMES[label],
            response_ms=640,
        )
        done = world.execute(board, ACTIONS[session.action], session.step)
        board = done.board
        taken = StepTaken(session.decision, done.reward, done.outcome, board.state_key(), board.to_xsb())
        advance(session, 0, answer_given(message, NUMBERS))
        advance(session, 0, taken)
        yield Input(began, encode(message), taken)


PARTS = ("decode", "translate", "close", "rows", "learn", "acknowledge")
Clock = Callable[[], int]


def step(
    session: Session, given: Input, rows: list[bytes], at_ns: int, clock: Clock | None = None
) -> list[int]:
    """Do one step and return the clock's readings between its parts; without a clock, none."""
    marks = [] if clock is None else [clock()]
    message = decode(given.payload, Answer)
    if clock:
        marks.append(clock())
    event = answer_given(message, NUMBERS)
    if clock:
        marks.append(clock())
    _, effects = advance(session, at_ns, event)
    if clock:
        marks.append(clock())
    told = effects[0]
    assert isinstance(told, Acknowledge)
    rows.append(answer_body(told.code, told.reason, given.payload))
    rows.append(step_body(given.taken, None))
    if clock:
        marks.append(clock())
    advance(session, at_ns, given.taken)
    if clock:
        marks.append(clock())
    check = blake2b(given.payload, digest_size=8).digest()
    encode(
        Acknowledgement(
            answer_id=message.answer_id,
            code=told.code.word,
            reason=told.reason,
            check=check,
            epoch=1,
            journal_seq=len(rows),
        )
    )
    if clock:
        marks.append(clock())
    return marks


def totals(inputs: list[Input], clock: Clock) -> list[int]:
    """CPU ns of each step."""
    session, rows, times = started(), [b""], []
    for at_ns, given in enumerate(inputs):
        if given.began:
            advance(session, at_ns, given.began)
        before = clock()
        step(session, given, rows, at_ns)
        times.append(clock() - before)
        if len(rows) > 1024:
            rows.clear()  # a group was committed
    return times


def parts(inputs: list[Input], clock: Clock) -> dict[str, float]:
    """Median us of each part."""
    session, rows = started(), [b""]
    taken: list[list[int]] = []
    for at_ns, given in enumerate(inputs):
        if given.began:
            advance(session, at_ns, given.began)
        marks = step(session, given, rows, at_ns, clock)
        taken.append([after - before for before, after in pairwise(marks)])
        if len(rows) > 1024:
            rows.clear()
    own = clock_ns(clock)
    columns = zip(*taken, strict=True)
    return {
        name: (statistics.median(column) - own) / 1000 for name, column in zip(PARTS, columns, strict=True)
    }


def clock_ns(clock: Clock) -> float:
    """What two readings in a row are apart."""
    return statistics.median(-clock() + clock() for _ in range(10_000))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON document on stdout")
    parser.add_argument("--steps", type=int, default=50_000, help="steps to time (default: 50000)")
    arguments = parser.parse_args()
    inputs = list(recorded(arguments.steps))
    totals(inputs[:2000], time.thread_time_ns)  # warm up
    gc.collect()
    gc.freeze()
    own = clock_ns(time.thread_time_ns)
    times = sorted(each - own for each in totals(inputs, time.thread_time_ns))
    median_us, p99_us = times[len(times) // 2] / 1000, times[len(times) * 99 // 100] / 1000
    medians = parts(inputs, time.thread_time_ns)
    if arguments.json:
        result = {"steps": len(times), "median_us": median_us, "p99_us": p99_us, "parts_median_us": medians}
        print(json.dumps(result))
        return
    print(f"one live step: median {median_us:.1f} us, p99 {p99_us:.1f} us ({len(times)} steps)")
    for name, part_us in medians.items():
        print(f"  {name:12} {part_us:6.2f} us")


if __name__ == "__main__":
    main()
