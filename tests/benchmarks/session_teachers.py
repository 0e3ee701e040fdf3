"""Teachers of many sessions in one process, on one connection: the load of `sessions.py`.

Run as `python tests/benchmarks/session_teachers.py ENDPOINT DEPLOYMENT`. It prints "ready", then obeys one
JSON command a line and answers each with one JSON line, until its stdin closes.

    {"do": "raw", "rate": 500, "seconds": 5}
        ask a bare echo at that rate through the same router
    {"do": "teach", "sessions": [names], "ramp": 2, "warm": 3, "seconds": 20, "window_ms": 1000}
        join each session within `ramp` seconds, answer each of its decisions once, at a moment of the window
    {"do": "hurry", "session": name, "answers": 1000}
        answer each decision of one session at once: as fast as it goes
"""

import gc
import heapq
import json
import os
import queue
import random
import sys
import threading
import time
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import msgspec

from protocol.codec import decode, encode
from protocol.keys import Keys
from protocol.messages import Answer, Join, Refusal
from services.runtime.bus import Reply
from services.runtime.zenoh_bus import ZenohBus, open_bus

NAME = "ann"
ASK_MS = 5_000
ANSWERED_WITHIN = 0.9
"""Share of the window in which somebody answers: nobody means to be late."""
AGAIN_S = 0.1
DRAIN_S = 15.0
PAUSE = threading.Event()
"""Never set: what waits for it waits that long."""


class Asked(msgspec.Struct):
    """What an answer needs of a decision: teachers are not the subject here, so they read no more."""

    epoch: int
    decision: int
    episode: int
    step: int
    phase: str
    state: bytes
    actions: list[str]


class Joined(msgspec.Struct):
    """What a teacher needs of a welcome."""

    decision: Asked


class Told(msgspec.Struct):
    """What a teacher needs of an acknowledgement."""

    code: str


DECISIONS = msgspec.msgpack.Decoder(Asked)
WELCOMES = msgspec.msgpack.Decoder(Joined)
CODES = msgspec.msgpack.Decoder(Told)


@dataclass(slots=True)
class Teacher:
    """The teacher of one session."""

    session: str
    answer_key: str
    joined: bool = False
    seen: int = -1


@dataclass(slots=True)
class Waiting:
    """An answer that was sent and is not acknowledged."""

    teacher: Teacher
    payload: bytes
    began: float
    measured: bool


@dataclass
class Tally:
    """What became of all answers."""

    latencies_us: list[int] = field(default_factory=list)
    late_us: list[int] = field(default_factory=list)
    """How much later than meant each answer was sent: what this process adds."""
    codes: dict[str, int] = field(default_factory=dict)
    refusals: dict[str, int] = field(default_factory=dict)
    sent: int = 0
    unanswered: int = 0
    decisions: int = 0
    """Decisions that asked, in the measured time."""


class Lesson:
    """Some sessions taught by this process."""

    def __init__(self, bus: ZenohBus, keys: Keys, sessions: list[str]) -> None:
        self._bus, self._keys = bus, keys
        self._inbox: queue.SimpleQueue[tuple[Any, ...]] = queue.SimpleQueue()
        self._due: list[tuple[float, int, Any]] = []
        self._number = 0
        self._chance = random.Random(os.getpid())
        self._teachers = [Teacher(name, keys.answer(name, NAME)) for name in sessions]
        self._waiting: set[int] = set()
        self._window_s = 0.0
        self._measured = (0.0, 0.0)
        self.tally = Tally()

    def teach(self, ramp: float, warm: float, seconds: float, window_ms: int) -> Tally:
        """Join and answer until the measured time is over and every answer is acknowledged."""
        now = time.perf_counter()
        self._window_s = window_ms / 1000
        self._measured = (now + ramp + warm, now + ramp + warm + seconds)
        for number, teacher in enumerate(self._teachers):
            self._later(now + ramp * number / len(self._teachers), partial(self._join, teacher))
        self._turn_until(lambda: time.perf_counter() >= self._measured[1])
        until = time.perf_counter() + DRAIN_S
        self._turn_until(lambda: not self._waiting or time.perf_counter() > until)
        return self.tally

    def hurry(self, answers: int) -> Tally:
        """Join and answer every decision at once until so many answers are timed."""
        self._measured = (0.0, float("inf"))
        self._join(self._teachers[0])
        until = time.perf_counter() + DRAIN_S
        self._turn_until(lambda: len(self.tally.latencies_us) >= answers or time.perf_counter() > until)
        self._measured = (0.0, 0.0)
        self._turn_until(lambda: not self._waiting or time.perf_counter() > until)
        return self.tally

    # ------------------------------------------------------------ the loop

    def _turn_until(self, over: Any) -> None:  # noqa: ANN401 - a predicate
        while not over():
            now = time.perf_counter()
            while self._due and self._due[0][0] <= now:
                due, _, act = heapq.heappop(self._due)
                act(due)
            pause = min(0.05, self._due[0][0] - now) if self._due else 0.05
            try:
                item = self._inbox.get(timeout=max(0.0, pause))
                while True:
                    item[0](*item[1:])
                    item = self._inbox.get_nowait()
            except queue.Empty:
                continue

    def _later(self, at: float, act: Any) -> None:  # noqa: ANN401 - what is done then
        self._number += 1
        heapq.heappush(self._due, (at, self._number, act))

    # ------------------------------------------------------------ joining

    def _join(self, teacher: Teacher, _due: float = 0.0) -> None:
        keys, inbox, name = self._keys, self._inbox, teacher.session
        self._bus.subscribe(
            keys.decision(name), lambda received: inbox.put((self._hear, teacher, received.payload))
        )
        self._bus.announce(keys.present(name, NAME))
        self._ask_in(teacher)

    def _ask_in(self, teacher: Teacher, _due: float = 0.0) -> None:
        self._bus.ask(
            self._keys.join(teacher.session, NAME),
            encode(Join(session=teacher.session, teacher=NAME)),
            lambda reply: self._inbox.put((self._joined, teacher, reply)),
            ASK_MS,
        )

    def _joined(self, teacher: Teacher, reply: Reply | None) -> None:
        if reply is None or not reply.ok:
            self._refused(reply)
            self._later(time.perf_counter() + AGAIN_S, partial(self._ask_in, teacher))
            return
        teacher.joined = True
        self._asked(teacher, WELCOMES.decode(reply.payload).decision)

    # ------------------------------------------------------------ answering

    def _hear(self, teacher: Teacher, payload: bytes) -> None:
        self._asked(teacher, DECISIONS.decode(payload))

    def _asked(self, teacher: Teacher, decision: Asked) -> None:
        if decision.phase != "asking" or decision.decision <= teacher.seen or not teacher.joined:
            return
        teacher.seen = decision.decision
        now = time.perf_counter()
        self.tally.decisions += self._measured[0] <= now < self._measured[1]
        wait_s = self._chance.uniform(0.0, ANSWERED_WITHIN) * self._window_s
        if wait_s:
            self._later(now + wait_s, partial(self._answer, teacher, decision))
        else:
            self._answer(teacher, decision, now)

    def _answer(self, teacher: Teacher, decision: Asked, due: float) -> None:
        began = time.perf_counter()
        if began >= self._measured[1]:
            return
        payload = encode(
            Answer(
                answer_id=os.urandom(16), session=teacher.session, teacher=NAME, epoch=decision.epoch,
                decision=decision.decision, episode=decision.episode, step=decision.step,
                state=decision.state, kind="label", action=self._chance.choice(decision.actions),
                response_ms=0,
            )
        )  # fmt: skip
        measured = began >= self._measured[0]
        self.tally.sent += 1
        if measured:
            self.tally.late_us.append(int(1e6 * (began - due)))
        self._send(Waiting(teacher, payload, time.perf_counter(), measured))

    def _send(self, waiting: Waiting, _due: float = 0.0) -> None:
        self._waiting.add(id(waiting))
        self._bus.ask(
            waiting.teacher.answer_key,
            waiting.payload,
            lambda reply: self._inbox.put((self._settle, waiting, reply, time.perf_counter())),
            ASK_MS,
        )

    def _settle(self, waiting: Waiting, reply: Reply | None, at: float) -> None:
        if reply is None or not reply.ok:
            self._refused(reply)
            self._later(time.perf_counter() + AGAIN_S, partial(self._send, waiting))
            return
        self._waiting.discard(id(waiting))
        code = CODES.decode(reply.payload).code
        self.tally.codes[code] = self.tally.codes.get(code, 0) + 1
        if waiting.measured:
            self.tally.latencies_us.append(int(1e6 * (at - waiting.began)))

    def _refused(self, reply: Reply | None) -> None:
        if reply is None:
            self.tally.unanswered += 1
            return
        code = decode(reply.payload, Refusal).code
        self.tally.refusals[code] = self.tally.refusals.get(code, 0) + 1


def raw(bus: ZenohBus, rate: float, seconds: float) -> list[int]:
    """Return the times in us of bare queries, sent at an even rate and not one after the other."""
    done: queue.SimpleQueue[tuple[float, float, bool]] = queue.SimpleQueue()
    begun, count = time.perf_counter(), int(rate * seconds)
    for number in range(count):
        pause = begun + number / rate - time.perf_counter()
        if pause > 0:
            PAUSE.wait(pause)
        sent = time.perf_counter()
        bus.ask(
            "bare/echo", b"x" * 220,
            lambda reply, sent=sent: done.put((sent, time.perf_counter(), reply is not None)),  # type: ignore[misc]
            ASK_MS,
        )  # fmt: skip
    outcomes = [done.get() for _ in range(count)]
    assert all(answered for *_, answered in outcomes)
    return [int(1e6 * (at - sent)) for sent, at, _ in outcomes]


def obey(bus: ZenohBus, keys: Keys, command: dict[str, Any]) -> dict[str, Any]:
    """Do what a line says and return what came of it."""
    match command.pop("do"):
        case "raw":
            return {"latencies_us": raw(bus, **command)}
        case "teach":
            return vars(Lesson(bus, keys, command.pop("sessions")).teach(**command))
        case "hurry":
            return vars(Lesson(bus, keys, [command["session"]]).hurry(command["answers"]))
        case what:
            message = f"no command {what}"
            raise ValueError(message)


def main() -> None:
    """Obey until stdin closes."""
    gc.disable()  # a pause of these processes would be taken for one of the learner
    endpoint, deployment = sys.argv[1:]
    bus, keys = open_bus(endpoint, 5_000), Keys(deployment)
    print("ready", flush=True)
    for line in sys.stdin:
        print(json.dumps(obey(bus, keys, json.loads(line))), flush=True)
    bus.close()


if __name__ == "__main__":
    main()
