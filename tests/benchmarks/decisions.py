"""Lock-step decisions per second across three processes, beside the bare round trips that they need.

One decision: the learner publishes it, the teacher answers by a query, the learner acknowledges after the
commit, has the action executed by a query to the environment, learns, and publishes the next. The anchor
sends messages of about the same sizes the same way round between three bare Zenoh processes on one router,
without content. Rounds of both are interleaved.
"""

import argparse
import queue
import statistics
import time

import bare as bare_peer
from rig import Rig, bare, print_result, services, session_config

from protocol.messages import WindowSpec
from services.client import Client, Opened
from services.outbox import Outbox
from services.runtime.clock import SystemClock

ROUNDS = 7
DECISIONS_A_ROUND = 600


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    as_json = parser.parse_args().json
    with services() as rig, bare(rig.endpoint, "environment", "learner"):
        window = WindowSpec(mode="until-answered", span_ms=2_000)
        rig.operator.create(session_config("lockstep", window, 1_000_000))
        result = _measure(rig)
    print_result(result, as_json=as_json)


def _measure(rig: Rig) -> dict[str, object]:
    clock = SystemClock()
    rates, bare_rates = [], []
    with (
        Client(
            rig.bus, rig.keys, "lockstep", "bench", outbox=Outbox(), clock=clock, measures=False
        ) as client,
        bare_peer.open_session(rig.endpoint) as session,
    ):
        decided: queue.SimpleQueue[object] = queue.SimpleQueue()
        session.declare_subscriber(f"{bare_peer.ROOT}/decision", bare_peer.direct(decided.put))
        _teach(client, 200)
        _exchange(session, decided, 200)
        for _ in range(ROUNDS):
            rates.append(_teach(client, DECISIONS_A_ROUND))
            bare_rates.append(_exchange(session, decided, DECISIONS_A_ROUND))
    return {
        "decisions_per_second": statistics.median(rates),
        "bare_rounds_per_second": statistics.median(bare_rates),
        "ratio_to_bare": statistics.median(ours / bare for ours, bare in zip(rates, bare_rates, strict=True)),
        "ratio_target": 0.5,
        "rounds": ROUNDS,
    }


def _teach(client: Client, decisions: int) -> float:
    """Answer that many decisions as they open; return decisions per second."""
    start = time.perf_counter()
    answered = 0
    while answered < decisions:
        update = client.next(2.0)
        assert update is not None, "no decision within two seconds"
        if (
            isinstance(update, Opened)
            and update.decision.phase == "asking"
            and not client.has_answered(update.decision)
        ):
            client.answer(update.decision, kind="label", action=update.decision.actions[answered % 4])
            answered += 1
    return decisions / (time.perf_counter() - start)


def _exchange(session: object, decided: "queue.SimpleQueue[object]", rounds: int) -> float:
    """Do that many bare rounds; return rounds per second."""
    start = time.perf_counter()
    for _ in range(rounds):
        session.get(  # type: ignore[attr-defined]
            f"{bare_peer.ROOT}/answer",
            bare_peer.direct(lambda _reply: None),
            payload=bare_peer.PAYLOAD,
            timeout=2.0,
        )
        decided.get(timeout=2.0)
    return rounds / (time.perf_counter() - start)


if __name__ == "__main__":
    main()
