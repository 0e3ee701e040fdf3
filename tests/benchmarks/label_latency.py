"""Time from sending a label to its durable acknowledgement, beside what it cannot do without.

The anchor, in the same run and interleaved with it: a bare Zenoh query through the same router, and as many
syncs of a file on the same disk as the journal performs for one acknowledgement, one after the other (the
journal lets its two run side by side). Then 32 teachers at once.
"""

import argparse
import os
import queue
import statistics
import time

from rig import Rig, bare, disk_kind, percentile, print_result, services, session_config, sync_seconds

from protocol.codec import decode, encode
from protocol.messages import Acknowledgement, Answer, Join, Welcome, WindowSpec
from services.runtime.bus import Reply
from services.runtime.zenoh_bus import open_bus

ROUNDS = 40
LABELS_A_ROUND = 50
SYNCS_A_COMMIT = 2
"""One of SQLite's write-ahead log, one of the mirror log."""
TEACHERS = 32
CONNECTIONS = 8
"""Processes of teachers are not the subject here: eight connections share their load."""
LOAD_SECONDS = 6.0


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    as_json = parser.parse_args().json
    with services() as rig, bare(rig.endpoint, "echo"):
        window = WindowSpec(mode="full", span_ms=3_600_000)
        rig.operator.create(session_config("latency", window, 10))
        result = _latency(rig, _welcome(rig, "t0"))
        result |= _load(rig)
    print_result(result, as_json=as_json)


def _ask(bus: object, key: str, payload: bytes) -> Reply:
    replies: queue.SimpleQueue[Reply | None] = queue.SimpleQueue()
    bus.ask(key, payload, replies.put, 2_000)  # type: ignore[attr-defined]
    reply = replies.get()
    assert reply is not None
    assert reply.ok, reply.payload
    return reply


def _welcome(rig: Rig, teacher: str) -> Welcome:
    """Join and return the welcome to the open decision."""
    rig.bus.announce(rig.keys.present("latency", teacher))
    deadline = time.monotonic() + 10
    while True:
        payload = encode(Join(session="latency", teacher=teacher))
        welcome = decode(_ask(rig.bus, rig.keys.join("latency", teacher), payload).payload, Welcome)
        if welcome.decision.phase == "asking":
            return welcome
        assert time.monotonic() < deadline, welcome.decision.phase


def _answer(welcome: Welcome, teacher: str) -> bytes:
    decision = welcome.decision
    return encode(
        Answer(
            answer_id=os.urandom(16), session="latency", teacher=teacher, epoch=welcome.epoch,
            decision=decision.decision, episode=decision.episode, step=decision.step, state=decision.state,
            kind="label", action="UP", response_ms=0,
        )
    )  # fmt: skip


def _latency(rig: Rig, welcome: Welcome) -> dict[str, object]:
    key = rig.keys.answer("latency", "t0")
    labels, queries, syncs, sums, ratios = [], [], [], [], []
    for _ in range(ROUNDS):
        payloads = [_answer(welcome, "t0") for _ in range(LABELS_A_ROUND)]
        mine = [_timed(lambda payload=payload: _check(_ask(rig.bus, key, payload))) for payload in payloads]
        bare_ones = [
            _timed(lambda payload=payload: _ask(rig.bus, "bare/echo", payload)) for payload in payloads
        ]
        disk = [sync_seconds(rig.data / "sync-probe", SYNCS_A_COMMIT) for _ in payloads]
        floor = statistics.median(bare_ones) + statistics.median(disk)
        labels += mine
        queries += bare_ones
        syncs += disk
        sums.append(floor)
        ratios.append(statistics.median(mine) / floor)
    return {
        "disk": disk_kind(rig.data),
        "labels": len(labels),
        "label_us_p50": statistics.median(labels) * 1e6,
        "label_us_p99": percentile(labels, 0.99) * 1e6,
        "bare_query_us_p50": statistics.median(queries) * 1e6,
        "syncs_a_label": SYNCS_A_COMMIT,
        "syncs_us_p50": statistics.median(syncs) * 1e6,
        "ratio_to_bare_query_and_syncs": statistics.median(ratios),
        "ratio_target": 1.5,
    }


def _timed(call: object) -> float:
    start = time.perf_counter()
    call()  # type: ignore[operator]
    return time.perf_counter() - start


def _check(reply: Reply) -> None:
    assert decode(reply.payload, Acknowledgement).code == "accepted"


def _load(rig: Rig) -> dict[str, object]:
    """Let 32 teachers answer as fast as they are acknowledged; everything they send was made before."""
    names = [f"t{number}" for number in range(TEACHERS)]
    welcomes = {name: _welcome(rig, name) for name in names}
    made = {name: iter([_answer(welcomes[name], name) for _ in range(2_000)]) for name in names}
    buses = [open_bus(rig.endpoint, 5_000) for _ in range(CONNECTIONS)]
    done: queue.SimpleQueue[tuple[str, float, Reply | None]] = queue.SimpleQueue()

    def send(name: str) -> None:
        bus = buses[names.index(name) % CONNECTIONS]
        start = time.perf_counter()
        bus.ask(
            rig.keys.answer("latency", name),
            next(made[name]),
            lambda reply: done.put((name, start, reply)),
            2_000,
        )

    for name in names:
        send(name)
    latencies: list[float] = []
    begun = time.perf_counter()
    now = begun
    while now - begun < LOAD_SECONDS:
        name, start, reply = done.get()
        now = time.perf_counter()
        assert reply is not None
        assert reply.ok, reply.payload
        latencies.append(now - start)
        send(name)
    for _ in names:
        done.get()
    for bus in buses:
        bus.close()
    return {
        "teachers": TEACHERS,
        "acknowledgements_per_second": len(latencies) / (now - begun),
        "acknowledgements_target": 5_000,
        "load_us_p50": statistics.median(latencies) * 1e6,
        "load_us_p99": percentile(latencies, 0.99) * 1e6,
    }


if __name__ == "__main__":
    main()
