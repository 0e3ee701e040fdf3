"""Two hundred people at the teaching page: the time from a frame sent to its acknowledgement.

Real services and one gateway in processes of their own; the browsers are websocket clients of this process,
each on a connection of its own, who answer once in every window of one second, at a moment of their own.
Every acknowledgement follows a sync of the learner's disk. At the end the learner's own count is compared: an
answer that was sent and is not in its journal is lost, and the run fails.

    python tests/benchmarks/page_participants.py [--people 200] [--answers 5000] [--sessions 1] [--runs 3]
        [--json]
"""

import argparse
import asyncio
import contextlib
import gc
import json
import os
import random
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rig
from websockets.asyncio.client import ClientConnection, connect

from protocol.identity import Identity, Role, sign
from protocol.messages import WindowSpec
from services.cli.shared import launch
from services.gateway.service import read_status
from services.runtime.config import GatewaySection
from services.runtime.register import new_token_id
from services.runtime.secret import load_secrets
from services.runtime.signals import Stop

TARGET_P99_MS = 50.0
WINDOW_MS = 1000
ANSWERED_WITHIN_S = 0.9
SETTLE_S = 5.0
WARM_UP_DECISIONS = 3
COPIED = ("session", "epoch", "decision", "episode", "step", "state")


@dataclass
class Course:
    """What all participants share: the figures, and when it is over."""

    answers: int
    chance: random.Random
    sent: int = 0
    settled: int = 0
    latencies_ms: list[float] = field(default_factory=list)
    codes: dict[str, int] = field(default_factory=dict)
    over: asyncio.Event = field(default_factory=asyncio.Event)
    settled_all: asyncio.Event = field(default_factory=asyncio.Event)


class Participant:
    """One browser: answers each decision once, and times the acknowledgement."""

    def __init__(self, course: Course, socket: ClientConnection, number: int) -> None:
        self._course, self._socket, self._number = course, socket, number
        self._open: dict[str, tuple[float, bool]] = {}
        self._seen = -1
        self._said = 0

    async def teach(self) -> None:
        """Take part until the course is over."""
        async for text in self._socket:
            frame = json.loads(text)
            if frame["type"] == "decision" and frame["phase"] == "asking" and frame["decision"] > self._seen:
                self._seen = frame["decision"]
                wait_s = self._course.chance.uniform(0.0, ANSWERED_WITHIN_S)
                asyncio.get_running_loop().call_later(wait_s, self._answer, frame)
            elif frame["type"] == "answer" and frame["state"] not in {"retrying", "sending"}:
                self._settle(frame)

    def _answer(self, decision: dict[str, Any]) -> None:
        course = self._course
        if course.over.is_set():
            return
        measured = decision["decision"] >= WARM_UP_DECISIONS
        self._said += 1
        answer_id = f"{self._number:016x}{self._said:016x}"
        fields = {name: decision[name] for name in COPIED}
        text = json.dumps({"type": "answer", "id": answer_id, "kind": "label", "action": "UP", **fields})
        course.sent += 1
        self._open[answer_id] = (time.perf_counter(), measured)
        self._sending = asyncio.ensure_future(self._socket.send(text))

    def _settle(self, frame: dict[str, Any]) -> None:
        course = self._course
        began, measured = self._open.pop(frame["id"])
        course.settled += 1
        course.codes[frame["code"]] = course.codes.get(frame["code"], 0) + 1
        if measured:
            course.latencies_ms.append(1000 * (time.perf_counter() - began))
        if len(course.latencies_ms) >= course.answers:
            course.over.set()
        if course.over.is_set() and course.settled == course.sent:
            course.settled_all.set()


async def attend(url: str, tokens: list[str], answers: int) -> Course:
    """Let everybody teach until so many answers have been timed and all are settled."""
    course = Course(answers, random.Random(1))
    address = url.replace("http", "ws", 1) + "/socket"
    async with asyncio.TaskGroup() as group:
        tasks = []
        for number, token in enumerate(tokens):
            socket = await connect(address, origin=url, compression=None, proxy=None, ping_interval=None)  # type: ignore[arg-type]
            await socket.send(json.dumps({"type": "hello", "version": 1, "token": token, "nonce": "0" * 32}))
            tasks.append(group.create_task(Participant(course, socket, number).teach()))
        gc.collect()
        gc.freeze()
        await course.over.wait()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(SETTLE_S):
                await course.settled_all.wait()
        for task in tasks:
            task.cancel()
    return course


def one_run(people: int, answers: int, sessions: int) -> dict[str, object]:
    """Return the figures of one course with fresh services."""
    with rig.services() as running, ExitStack() as stack:
        deployed = launch.Deployed(running.data, running.endpoint, "bench", guarded=False)
        supervisor = launch.supervise(running.data, running.data / "logs", Stop())
        stack.callback(supervisor.stop)
        supervisor.start(launch.gateway(deployed, GatewaySection(enabled=True, listen="127.0.0.1:0")))
        window = WindowSpec(mode="full", span_ms=WINDOW_MS)
        names = [f"page{number}" for number in range(sessions)]
        each = people // sessions
        for name in names:
            running.operator.create(rig.session_config(name, window, 10_000, teachers_min=each))
        tokens = [token(running.data, names[number % sessions], number) for number in range(people)]
        course = asyncio.run(attend(str(read_status(running.data)["url"]), tokens, answers))
        journaled = sum(running.operator.show(name)[0].labels.submitted for name in names)
    latencies = course.latencies_ms
    return {
        "people": people,
        "sessions": sessions,
        "answers": len(latencies),
        "p50_ms": rig.percentile(latencies, 0.5),
        "p99_ms": rig.percentile(latencies, 0.99),
        "max_ms": max(latencies),
        "sent": course.sent,
        "acknowledged": course.settled,
        "journaled": journaled,
        "lost": course.sent - min(course.settled, journaled),
        "codes": course.codes,
        "load_average": os.getloadavg()[0],
    }


def token(data: Path, session: str, number: int) -> str:
    """Return a participant's token."""
    identity = Identity(
        role=Role.TEACHER,
        session=session,
        pseudonym=f"p{number:04d}",
        expires_s=int(time.time()) + 3600,
        token_id=new_token_id(),
    )
    return sign(identity, load_secrets(data / "gateway"))


def main() -> None:
    """Run and print; exit 1 when an answer was lost or the target was missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    for name, default in (("people", 200), ("answers", 5000), ("sessions", 1), ("runs", 3)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    runs = [one_run(chosen.people, chosen.answers, chosen.sessions) for _ in range(chosen.runs)]
    worst = max(float(str(run["p99_ms"])) for run in runs)
    lost = sum(int(str(run["lost"])) for run in runs)
    result: dict[str, object] = {"target_p99_ms": TARGET_P99_MS, "worst_p99_ms": worst, "lost": lost}
    show: Callable[..., None] = rig.print_result
    if chosen.json:
        show(result | {"runs": runs}, as_json=True)
    else:
        for run in runs:
            show(run, as_json=False)
        show(result, as_json=False)
    sys.exit(0 if lost == 0 and worst <= TARGET_P99_MS else 1)


if __name__ == "__main__":
    main()
