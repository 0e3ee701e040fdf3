"""A learner with a long journal: how soon it acknowledges again, and how long a proof takes."""

import os
import resource
import subprocess
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from protocol.codec import decode
from protocol.keys import Keys
from protocol.messages import Acknowledgement, Answer
from services.router import free_endpoint
from services.runtime.bus import Reply
from services.runtime.journal import Shard
from services.runtime.zenoh_bus import ZenohBus, open_bus
from tests.services.cli.command_line import SFID
from tests.services.faults.long_journal import ACTIONS, SESSION, TEACHER, write_lesson

ASK_MS = 250
BACK_S = 60.0
ROWS_A_COMMIT = 512


class Back(NamedTuple):
    """How soon a killed learner serves again."""

    labels: int
    seconds: float
    """From its start to the acknowledgement of an answer that was acknowledged before."""
    processor_s: float
    """What the learner computed for it; on a quiet machine it takes hardly longer."""
    beside_s: float
    """What the process computed that proves the journal meanwhile, on another processor if there is one."""
    same: bool
    """Whether that acknowledgement names the answer's own row."""


class Proof(NamedTuple):
    """How long a proof takes."""

    labels: int
    seconds: float
    processor_s: float
    ok: bool


def kill_and_ask(labels: int, data: Path) -> Back:
    """Kill a learner that holds so many labels, start it again, and send an answer until acknowledged."""
    written = write_lesson(data, labels)
    endpoint = free_endpoint()
    with ExitStack() as stack:
        _process(stack, "router", "--listen", endpoint, "--open-to-all")
        bus = open_bus(endpoint, 20_000)
        stack.callback(bus.close)
        command = ("learner", "--connect", endpoint, "--data", str(data))
        first = _process(stack, *command)
        _acknowledged(bus, written.last)
        first.kill()
        first.wait(10)
        began = time.monotonic()
        second = _process(stack, *command)
        reply = _acknowledged(bus, written.last)
        seconds, (processor_s, beside_s) = time.monotonic() - began, _processor_s(second.pid)
    told = decode(reply, Acknowledgement)
    # Behind the last answer stand its step and the digest.
    same = (told.code, told.journal_seq) == ("accepted", written.rows - 2)
    return Back(labels, round(seconds, 2), round(processor_s, 2), round(beside_s, 2), same)


def _processor_s(pid: int) -> tuple[float, float]:
    """Return what a process has computed, and what its ended children have."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    own, beside, tick = fields[11:13], fields[13:15], os.sysconf("SC_CLK_TCK")
    return sum(map(int, own)) / tick, sum(map(int, beside)) / tick


def prove(labels: int, data: Path) -> Proof:
    """Write a journal of so many labels and measure `sfid verify` as a person runs it."""
    body = bytes(220)
    with Shard.open(data) as shard:
        for number in range(labels):
            unique = number.to_bytes(16, "big")
            shard.append(SESSION, "answer", body, at_ns=number, unique=unique, person=TEACHER)
            if number % ROWS_A_COMMIT == 0:
                shard.commit()
    began, computed_s = time.monotonic(), _children_s()
    done = subprocess.run([SFID, "verify", str(data)], check=False, capture_output=True, timeout=300)
    seconds, computed_s = time.monotonic() - began, _children_s() - computed_s
    return Proof(labels, round(seconds, 2), round(computed_s, 2), done.returncode == 0)


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _process(stack: ExitStack, *arguments: str) -> subprocess.Popen[bytes]:
    process = subprocess.Popen(
        [SFID, *arguments], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )

    def end() -> None:
        process.kill()
        process.wait(10)

    stack.callback(end)
    return process


def _acknowledged(bus: ZenohBus, payload: bytes) -> bytes:
    """Send an answer again and again, as a teacher does, until it is acknowledged."""
    assert decode(payload, Answer).action in ACTIONS
    key, until = Keys("local").answer(SESSION, TEACHER), time.monotonic() + BACK_S
    while time.monotonic() < until:
        told: list[Reply | None] = []
        heard = threading.Event()

        def hear(
            reply: Reply | None, told: list[Reply | None] = told, heard: threading.Event = heard
        ) -> None:
            told.append(reply)
            heard.set()

        bus.ask(key, payload, hear, ASK_MS)
        heard.wait(2 * ASK_MS / 1000)
        if told and told[0] is not None and told[0].ok:
            return told[0].payload
        threading.Event().wait(0.02)
    message = f"not acknowledged within {BACK_S} s"
    raise AssertionError(message)
