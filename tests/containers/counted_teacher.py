"""Teaches one session from a container until it is stopped; prints the id of every acknowledged answer.

Run as `python counted_teacher.py SESSION NAME DEPLOYMENT PACE_MS` in the image of the services.
"""

import sys
import time
from pathlib import Path

from services.client import AnswerState, AnswerUpdate, Client, Opened, join
from services.runtime.signals import Stop, StopSignals

ROUTER_MAX_MS = 30_000
DRAIN_S = 8.0
KEPT = frozenset({AnswerState.SAVED, AnswerState.TOO_LATE})


def teach(client: Client, stop: Stop, pace_s: float) -> None:
    """Answer every decision, and print what is acknowledged."""
    spoken = 0
    until = None
    while until is None or (client.unacknowledged and time.monotonic() < until):
        if until is None and stop.is_set():
            until = time.monotonic() + DRAIN_S
        match client.next(0.1):
            case Opened(decision) if until is None and decision.phase == "asking":
                if not client.has_answered(decision):
                    stop.wait(pace_s)
                    spoken += 1
                    client.answer(decision, action=decision.actions[spoken % len(decision.actions)])
            case AnswerUpdate(answer_id, state) if state in KEPT:
                sys.stdout.write(f"{answer_id.hex()}\n")
                sys.stdout.flush()
            case _:
                pass


def main() -> None:
    """Run until SIGTERM, then until every answer is acknowledged."""
    session, name, deployment, pace_ms = sys.argv[1:]
    stop = Stop()
    with (
        StopSignals(stop.set),
        join(
            "tcp/router:7447",
            session,
            name,
            deployment=deployment,
            connect_ms=ROUTER_MAX_MS,
            access=Path("/access"),
        ) as teaching,
    ):
        teach(teaching.client, stop, int(pace_ms) / 1000)


if __name__ == "__main__":
    main()
